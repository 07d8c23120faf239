"""`rcgen --to`: interfaces written in other languages."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.dsl.workspace import SHIPPED

from ..codegen.generated import copied, snapshot

Said = pytest.CaptureFixture[str]

LASER = str(SHIPPED / "Laser.idsl")
FORMATS = ("omgidl", "rosmsg")
WRITTEN = {
    "omgidl": {"RoboCompLaser.idl", "RoboCompGenericBase.idl"},
    "rosmsg": {"robocomp_laser/package.xml", "robocomp_generic_base/package.xml", "robocomp_laser/msg/TData.msg"},
}


@pytest.mark.parametrize("to", FORMATS)
def test_what_is_given_is_written_with_what_it_imports(to: str, tmp_path: Path, capsys: Said) -> None:
    assert rcgen([LASER, "--to", to, "-o", str(tmp_path / "out")]) == 0
    assert WRITTEN[to] <= snapshot(tmp_path / "out").keys()
    assert f"{to}: {len(snapshot(tmp_path / 'out'))} written in {tmp_path}/out/" in capsys.readouterr().out


@pytest.mark.parametrize("to", FORMATS)
def test_a_second_run_finds_everything_up_to_date(to: str, tmp_path: Path, capsys: Said) -> None:
    command = [LASER, "--to", to, "-o", str(tmp_path)]
    assert rcgen([*command, "--check"]) == 1
    assert rcgen(command) == 0
    before = snapshot(tmp_path)
    capsys.readouterr()
    assert rcgen([*command, "--check"]) == 0
    assert rcgen(command) == 0
    assert capsys.readouterr().out == f"{to}: up to date in {tmp_path}/\n"
    assert snapshot(tmp_path) == before


def test_without_a_folder_it_is_written_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert rcgen([LASER, "--to", "omgidl"]) == 0
    assert snapshot(tmp_path).keys() == WRITTEN["omgidl"]


def test_files_of_others_are_not_written_over(tmp_path: Path, capsys: Said) -> None:
    (tmp_path / "RoboCompLaser.idl").write_text("// mine\n")
    assert rcgen([LASER, "--to", "omgidl", "-o", str(tmp_path)]) == 1
    assert "was not written by rcgen" in capsys.readouterr().err
    assert snapshot(tmp_path) == {"RoboCompLaser.idl": b"// mine\n"}


def test_a_component_in_the_same_folder_is_left_alone(tmp_path: Path) -> None:
    cdsl = copied("plain", tmp_path)
    assert rcgen([str(cdsl)]) == 0
    before = snapshot(tmp_path)
    for to in FORMATS:
        assert rcgen([LASER, "--to", to, "-o", str(tmp_path)]) == 0
    assert before.items() <= snapshot(tmp_path).items()


MISTAKES = {"omgidl": "struct X { int a; };", "rosmsg": "struct S { int a; int A; };"}


@pytest.mark.parametrize("to", FORMATS)
def test_nothing_is_written_of_what_a_format_cannot_hold(to: str, tmp_path: Path, capsys: Said) -> None:
    (tmp_path / "X.idsl").write_text(f"module X {{ {MISTAKES[to]} }};")
    assert rcgen([str(tmp_path / "X.idsl"), "--to", to, "-o", str(tmp_path / "out")]) == 1
    assert f"error[not-in-{to}]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_files_that_define_the_same_are_refused(tmp_path: Path, capsys: Said) -> None:
    for name in ("A", "B"):
        (tmp_path / f"{name}.idsl").write_text("module X { struct S { float a; }; };")
    files = [str(tmp_path / "A.idsl"), str(tmp_path / "B.idsl")]
    assert rcgen([*files, "--to", "omgidl", "-o", str(tmp_path)]) == 1
    assert "both define X::S; give them to rcgen one by one" in capsys.readouterr().err


def test_an_interface_that_is_wrong_is_not_written(tmp_path: Path, capsys: Said) -> None:
    (tmp_path / "X.idsl").write_text("module X { struct S { Point p; }; };")
    assert rcgen([str(tmp_path / "X.idsl"), "--to", "omgidl", "-o", str(tmp_path / "out")]) == 1
    assert "error[unknown-type]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["x.cdsl", "--to", "omgidl"], 1, "x.cdsl is not an .idsl file; --to is for interfaces"),
        (["gone.idsl", "--to", "omgidl"], 1, "cannot be read"),
        (["--to", "omgidl"], 2, "give it .idsl files"),
        (["x.idsl", "--to", "proto"], 2, "--to: there is no `proto`; there are: omgidl, rosmsg"),
        (["x.idsl", "--to", "omgidl", "--middleware", "dds"], 2, "neither --new nor --middleware"),
        (["x.idsl"], 1, "or write it in another language by --to"),
        (["--json", "x.idsl", "--to", "omgidl"], 2, "--json is for generating components"),
    ],
)
def test_wrong_arguments_for_formats_are_explained(arguments: list[str], code: int, said: str, capsys: Said) -> None:
    try:
        found = rcgen(arguments)
    except SystemExit as exc:
        found = int(exc.code or 0)
    assert found == code
    assert said in capsys.readouterr().err
