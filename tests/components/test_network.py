"""The example network as a whole: its models, its generated parts, its story."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import robocomp_py
from robocomp_py.cli import rc, rcgen

from .conftest import COMPONENTS

INTERFACES = sorted((Path(robocomp_py.__file__).parent / "interfaces").glob("*.idsl"))


@pytest.mark.parametrize("path", INTERFACES, ids=lambda path: path.stem)
def test_the_shipped_interfaces_are_without_diagnostics(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["lint", str(path)]) == 0
    assert not any(capsys.readouterr())


def test_the_network_is_without_diagnostics(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["lint", str(COMPONENTS / "rescue.ddsl")]) == 0
    assert not any(capsys.readouterr())


def test_the_generated_parts_are_what_rcgen_makes_of_the_models(capsys: pytest.CaptureFixture[str]) -> None:
    assert rcgen.main(["--check", str(COMPONENTS / "rescue.ddsl")]) == 0, capsys.readouterr().out


def test_the_story_has_a_good_end(tmp_path: Path) -> None:
    picture = tmp_path / "story.svg"
    demo = [sys.executable, str(COMPONENTS / "demo.py"), "--fast", "--picture", str(picture)]
    done = subprocess.run(demo, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    said = done.stdout + done.stderr
    events = (
        "exploring",
        "battery low",
        "at the charging station",
        "battery charged",
        "found somebody",
        "help was called",
    )
    places = [said.find(event) for event in events]
    assert -1 not in places
    assert places == sorted(places)
    assert picture.read_text().startswith("<svg")
