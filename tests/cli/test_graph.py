"""`rc graph` from outside."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from robocomp_py.cli.rc import main as rc

Said = pytest.CaptureFixture[str]

GAME = "game { initial_state begin; end_state over; transitions { begin => over; }; };"
SCXML = '<scxml xmlns="http://www.w3.org/2005/07/scxml"><state id="a"><transition event="e" target="b"/></state>' \
        '<final id="b"/></scxml>'  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "game.smdsl").write_text(GAME)
    (tmp_path / "game.scxml").write_text(SCXML)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("file", ["game.smdsl", "game.scxml"])
def test_a_machine_is_drawn_into_a_file(folder: Path, file: str, capsys: Said) -> None:
    assert rc(["graph", file, "-o", "game.svg"]) == 0
    assert ElementTree.parse(folder / "game.svg").getroot().tag == "{http://www.w3.org/2000/svg}svg"
    assert capsys.readouterr() == ("", "")


def test_without_a_file_it_goes_to_stdout(folder: Path, capsys: Said) -> None:
    assert rc(["graph", "game.smdsl"]) == 0
    assert capsys.readouterr().out.startswith("<svg ")


def test_a_machine_that_is_wrong_is_not_drawn_but_explained(folder: Path, capsys: Said) -> None:
    (folder / "game.smdsl").write_text(GAME.replace("=> over", "=> ovr"))
    assert rc(["graph", "game.smdsl", "-o", "game.svg"]) == 1
    assert "did you mean `over`?" in capsys.readouterr().err
    assert not (folder / "game.svg").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["game.cdsl"], "game.cdsl is no state machine"),
        (["game.smdsl", "-o", "game.png"], "what is written is SVG"),
        (["game.smdsl", "-o", "nowhere/game.svg"], "nowhere/game.svg: No such file or directory"),
        (["missing.smdsl"], "cannot be read: No such file or directory"),
    ],
)
def test_what_cannot_be_done_is_said(folder: Path, capsys: Said, arguments: list[str], said: str) -> None:
    assert rc(["graph", *arguments]) == 1
    assert said in capsys.readouterr().err
