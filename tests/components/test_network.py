"""The example network as a whole: its models, its generated parts, its story."""

from __future__ import annotations

from pathlib import Path

import pytest

import robocomp_py
from robocomp_py.cli import rc, rcgen

from . import story
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
    story.check(story.run(COMPONENTS / "demo.py", "--fast", "--picture", picture, cwd=tmp_path))
    assert picture.read_text().startswith("<svg")
