"""`rc graph` from outside."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcgen import main as rcgen

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


NETWORK = 'import "arm.cdsl"; Deployment net { Component left : arm { }; Component right : arm { }; };'


@pytest.fixture
def network(folder: Path) -> Path:
    (folder / "arm.cdsl").write_text("Component arm { language python; };")
    assert rcgen(["arm.cdsl"]) == 0
    path = folder / "net.ddsl"
    path.write_text(NETWORK)
    return path


@pytest.mark.parametrize(
    ("picture", "begin"),
    [("net.svg", b"<svg "), ("net.png", b"\x89PNG"), ("net.dot", b'digraph "net" {'), ("net.mmd", b"flowchart TB")],
)
def test_a_network_is_drawn_in_the_way_that_its_name_says(
    network: Path, picture: str, begin: bytes, capsys: Said
) -> None:
    capsys.readouterr()
    assert rc(["graph", str(network), "-o", picture]) == 0
    assert capsys.readouterr() == ("", "")
    assert Path(picture).read_bytes().startswith(begin)


def test_a_network_and_a_machine_are_told_to_machines(network: Path, capsys: Said) -> None:
    capsys.readouterr()
    assert rc(["graph", str(network), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["network"], told["links"]) == ("net", [])
    assert [(each["name"], each["component"], each["within"]) for each in told["components"]] == [
        ("left", "arm", []),
        ("right", "arm", []),
    ]
    assert rc(["graph", "game.scxml", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["transitions"] == [{"from": "a", "to": "b", "events": ["e"]}]
    assert [(each["name"], each["final"]) for each in told["states"]] == [("a", False), ("b", True)]


def test_a_machine_can_be_drawn_as_pixels(folder: Path) -> None:
    assert rc(["graph", "game.smdsl", "-o", "game.png"]) == 0
    assert (folder / "game.png").read_bytes().startswith(b"\x89PNG")


def test_a_network_that_is_wrong_is_not_drawn_but_explained(network: Path, capsys: Said) -> None:
    network.write_text(NETWORK.replace("right : arm", "right : amr"))
    assert rc(["graph", str(network), "-o", "net.svg"]) == 1
    assert "did you mean `arm`?" in capsys.readouterr().err
    assert not Path("net.svg").exists()


def test_without_what_makes_pixels_it_is_said_what_to_install(
    network: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said
) -> None:
    monkeypatch.setitem(sys.modules, "resvg_py", None)
    assert rc(["graph", str(network), "-o", "net.png"]) == 1
    assert "pip install 'robocomp-py[png]'; or write .svg" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (
            ["game.cdsl"],
            1,
            "game.cdsl is neither the file of a network nor of a state machine; give it .ddsl, .smdsl or .scxml",
        ),
        (["game.smdsl", "-o", "game.dot"], 2, "game.dot: a state machine is drawn as .svg, .png; use one of these"),
        (["net.ddsl", "-o", "net.jpg"], 2, "net.jpg: a network is drawn as .svg, .png, .dot, .mmd; use one of these"),
        (["game.smdsl", "-o", "nowhere/game.svg"], 1, "nowhere/game.svg: No such file or directory"),
        (["missing.smdsl"], 1, "cannot be read: No such file or directory"),
    ],
)
def test_what_cannot_be_done_is_said(folder: Path, capsys: Said, arguments: list[str], code: int, said: str) -> None:
    assert rc(["graph", *arguments]) == code
    assert said in capsys.readouterr().err


# What runs.


def test_what_is_declared_and_does_not_run_is_drawn_as_missing(network: Path, capsys: Said) -> None:
    assert rc(["graph", "net.ddsl", "--live", "-o", "now.svg"]) == 0
    drawn = (network.parent / "now.svg").read_text()
    boxes = [each for each in ElementTree.fromstring(drawn).iter() if each.get("class") == "missing"]
    assert [each.tag.rpartition("}")[2] for each in boxes] == ["rect", "rect"]
    assert capsys.readouterr() == ("", "")
    assert rc(["graph", "net.ddsl", "--live", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [(each["name"], each["mark"]) for each in told["components"]] == [("left", "missing"), ("right", "missing")]


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["nowhere", "--live"], 1, "network `nowhere` is not running on this machine; give it a DDSL file"),
        (["nowhere.ddsl", "--live"], 1, "nowhere.ddsl cannot be read"),
        (["net.ddsl", "--live", "--middleware", "dds"], 2, "--live shows what runs: leave out --middleware and --set"),
        (["net.ddsl", "--live", "-o", "net.dot"], 2, "net.dot: what runs is drawn as .svg, .png; use one of these"),
    ],
)
def test_what_cannot_be_drawn_alive_is_told(
    network: Path, words: list[str], code: int, text: str, capsys: Said
) -> None:
    assert rc(["graph", *words]) == code
    assert text in capsys.readouterr().err
