"""Pages work as written: a reader who does what they say, from the first step to the last, sees what they show."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from .pages import DOCS, ROOT
from .reader import follow

LONG = pytest.mark.tool  # needs nothing but time: `make test` has less of it than `make test-tools`

pytestmark = pytest.mark.timeout(900)  # a page has up to 30 commands, and each of them a deadline of its own


@pytest.mark.parametrize(
    ("page", "least"),
    [
        ("README", 8),
        ("docs/guides/actions", 9),
        ("docs/guides/existing", 5),
        ("docs/explanation/handedness", 1),
        ("docs/guides/hosts", 6),
        ("docs/guides/importing", 3),
        pytest.param("docs/guides/named-instances", 15, marks=LONG),
        ("docs/guides/processes", 6),
        ("docs/guides/rerun", 8),
        ("docs/guides/ros2", 1),
        ("docs/guides/security", 6),
        ("docs/guides/simulating", 9),
        ("docs/guides/supervision", 4),
        ("docs/guides/testing", 10),
        pytest.param("docs/tutorials/driving-robot", 14, marks=LONG),
        pytest.param("docs/tutorials/first-component", 15, marks=LONG),
    ],
)
def test_a_page_works_as_written(page: str, least: int, tmp_path: Path) -> None:
    assert follow(ROOT / f"{page}.md", tmp_path) > least


@LONG
@pytest.mark.parametrize(
    ("page", "least", "network"),
    [
        ("guides/deploying", 12, "home"),
        ("guides/looking", 12, "house"),
        ("guides/scripts", 7, "house"),
        ("tutorials/stands-still", 20, "robot"),
        ("guides/recording", 8, "valley"),
        ("reference/time", 13, "watch"),
    ],
)
def test_a_page_with_a_detached_network_works_as_written(page: str, least: int, network: str, tmp_path: Path) -> None:
    try:
        assert follow(DOCS / f"{page}.md", tmp_path) > least
    finally:
        subprocess.run(
            [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "down", network, "--now"], capture_output=True
        )


def test_the_guide_to_state_machines_works_as_written_and_shows_the_picture_that_is_drawn(tmp_path: Path) -> None:
    assert follow(DOCS / "tutorials" / "state-machine.md", tmp_path) > 7
    assert (DOCS / "images" / "patrol.svg").read_text() == (tmp_path / "patrol.svg").read_text(), "draw it again"
