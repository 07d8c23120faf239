"""`rc fmt` as people use it."""

from __future__ import annotations

import io
import resource
import sys
from pathlib import Path

import pytest

from robocomp_py.cli.rc import main as rc

from ..docs.pages import ROOT, steps
from ..docs.reader import do

Said = pytest.CaptureFixture[str]

LOOSE = "module Arm{struct P{int x;}}"
TIDY = "module Arm\n{\n    struct P\n    {\n        int x;\n    };\n};\n"
WRONG = "module Arm { struct P { int x } };"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the command runs."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def give(monkeypatch: pytest.MonkeyPatch, data: bytes) -> None:
    """Let stdin be that."""
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))


def test_a_file_is_formatted_in_place(folder: Path, capsys: Said) -> None:
    (folder / "arm.idsl").write_text(LOOSE)
    assert rc(["fmt", "arm.idsl"]) == 0
    assert (folder / "arm.idsl").read_bytes() == TIDY.encode()
    assert capsys.readouterr().out == "formatted: arm.idsl\n"
    assert list(folder.iterdir()) == [folder / "arm.idsl"]


def test_a_formatted_file_is_not_touched(folder: Path, capsys: Said) -> None:
    (folder / "arm.idsl").write_text(TIDY)
    before = (folder / "arm.idsl").stat()
    assert rc(["fmt", "arm.idsl"]) == 0
    assert (folder / "arm.idsl").stat().st_ino == before.st_ino
    assert capsys.readouterr() == ("", "")


def test_a_file_with_wrong_syntax_is_left_and_the_others_are_formatted(folder: Path, capsys: Said) -> None:
    (folder / "a.idsl").write_text(WRONG)
    (folder / "b.idsl").write_text(LOOSE)
    assert rc(["fmt", "a.idsl", "b.idsl"]) == 1
    assert (folder / "a.idsl").read_text() == WRONG
    assert (folder / "b.idsl").read_text() == TIDY
    assert "a.idsl:1:29: error[syntax]: expected `;` before `}`" in capsys.readouterr().err


def test_what_is_wrong_but_for_the_syntax_is_not_told(folder: Path, capsys: Said) -> None:
    (folder / "arm.idsl").write_text('import "Nothing.idsl"; module Arm { struct P { Nobody x; }; };')
    assert rc(["fmt", "arm.idsl"]) == 0
    assert capsys.readouterr().err == ""


def test_check_lists_what_is_not_formatted_and_changes_nothing(folder: Path, capsys: Said) -> None:
    (folder / "a.idsl").write_text(LOOSE)
    (folder / "b.idsl").write_text(TIDY)
    assert rc(["fmt", "--check", "a.idsl", "b.idsl"]) == 1
    assert (folder / "a.idsl").read_text() == LOOSE
    assert capsys.readouterr().out == "would format: a.idsl\n"
    assert rc(["fmt", "--check", "b.idsl"]) == 0


def test_diff_shows_what_would_change_and_changes_nothing(folder: Path, capsys: Said) -> None:
    (folder / "a.idsl").write_text(f"// The arm.\n{LOOSE}")
    assert rc(["fmt", "--diff", "a.idsl"]) == 1
    assert (folder / "a.idsl").read_text() == f"// The arm.\n{LOOSE}"
    shown = capsys.readouterr().out.splitlines()
    assert shown[:2] == ["--- a.idsl", "+++ a.idsl"]
    assert shown[3:7] == [" // The arm.", f"-{LOOSE}", "\\ No newline at end of file", "+module Arm"]


def test_of_a_folder_all_files_of_the_languages_are_formatted(folder: Path, capsys: Said) -> None:
    for name in ("z/a.idsl", "z/B.IDSL", ".git/c.idsl", "z/.d.idsl", "z/notes.txt", "elsewhere/e.idsl"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(LOOSE)
    (folder / "z" / "link.idsl").symlink_to("../elsewhere/e.idsl")
    (folder / "z" / "loop").symlink_to(".")
    assert rc(["fmt", "z", "z/a.idsl"]) == 0
    assert capsys.readouterr().out == "formatted: z/B.IDSL\nformatted: z/a.idsl\n"
    assert (folder / "elsewhere" / "e.idsl").read_text() == LOOSE


def test_a_folder_without_such_files_is_a_mistake(folder: Path, capsys: Said) -> None:
    (folder / "empty").mkdir()
    assert rc(["fmt", "empty"]) == 1
    assert capsys.readouterr().err == "rc fmt: empty: no model files in this folder\n"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("arm.isdl", "arm.isdl: files with this ending are not formatted; known: .idsl, .cdsl, .pdsl, .ddsl, .smdsl"),
        ("leg.idsl", "leg.idsl: error[unreadable]: cannot be read: No such file or directory"),
        ("leg", "leg: error[unreadable]: cannot be read: No such file or directory"),
    ],
)
def test_a_file_that_cannot_be_formatted_is_reported(folder: Path, capsys: Said, name: str, said: str) -> None:
    (folder / "arm.isdl").write_text(LOOSE)
    assert rc(["fmt", name]) == 1
    assert said in capsys.readouterr().err


# What is written.


def test_a_file_keeps_its_permissions(folder: Path) -> None:
    (folder / "arm.idsl").write_text(LOOSE)
    (folder / "arm.idsl").chmod(0o751)
    assert rc(["fmt", "arm.idsl"]) == 0
    assert (folder / "arm.idsl").stat().st_mode & 0o777 == 0o751


def test_a_link_stays_one_and_what_it_leads_to_is_formatted(folder: Path) -> None:
    (folder / "real").mkdir()
    (folder / "real" / "arm.idsl").write_text(LOOSE)
    (folder / "arm.idsl").symlink_to("real/arm.idsl")
    assert rc(["fmt", "arm.idsl"]) == 0
    assert (folder / "arm.idsl").is_symlink()
    assert (folder / "real" / "arm.idsl").read_text() == TIDY


def test_line_ends_become_lf_and_a_byte_order_mark_goes(folder: Path) -> None:
    (folder / "arm.idsl").write_bytes(b"\xef\xbb\xbf" + TIDY.replace("\n", "\r\n").encode())
    assert rc(["fmt", "arm.idsl"]) == 0
    assert (folder / "arm.idsl").read_bytes() == TIDY.encode()


def test_a_file_that_is_not_utf8_keeps_its_bytes(folder: Path, capsys: Said) -> None:
    (folder / "arm.idsl").write_bytes(b"// c\xe1mara\r\nmodule M { };")
    assert rc(["fmt", "arm.idsl"]) == 0
    assert (folder / "arm.idsl").read_bytes() == b"// c\xe1mara\nmodule M { };\n"
    assert "warning[not-utf8]" in capsys.readouterr().err


def test_nothing_is_lost_if_it_cannot_be_written(folder: Path, capsys: Said) -> None:
    (folder / "arm.idsl").write_text(LOOSE)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    try:
        assert rc(["fmt", "arm.idsl"]) == 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert capsys.readouterr().err == "rc fmt: arm.idsl: File too large; the file is as it was\n"
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [("arm.idsl", LOOSE)]


# From stdin to stdout.


def test_stdin_is_formatted_to_stdout(
    capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    give(monkeypatch, LOOSE.encode())
    assert rc(["fmt", "-", "--language", "idsl"]) == 0
    assert capsysbinary.readouterr().out == TIDY.encode()


def test_of_wrong_stdin_nothing_is_written(capsys: Said, monkeypatch: pytest.MonkeyPatch) -> None:
    give(monkeypatch, WRONG.encode())
    assert rc(["fmt", "--language", "idsl", "-"]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("<stdin>:1:29: error[syntax]")


def test_stdin_can_be_checked(capsys: Said, monkeypatch: pytest.MonkeyPatch) -> None:
    give(monkeypatch, LOOSE.encode())
    assert rc(["fmt", "--check", "--language", "idsl", "-"]) == 1
    assert capsys.readouterr().out == "would format: <stdin>\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "FILE is missing"),
        (["-"], "say what stdin is, as in: rc fmt --language idsl -"),
        (["-", "--language", "idl"], "no language is called idl; did you mean idsl?"),
        (["-", "--language", "xml"], "no language is called xml"),
        (["-", "a.idsl", "--language", "idsl"], "stdin (-) cannot be combined with files"),
        (["a.idsl", "--language", "idsl"], "--language is for stdin (-); the ending of a file tells its language"),
    ],
)
def test_wrong_usage_is_reported_with_a_correction(capsys: Said, arguments: list[str], said: str) -> None:
    with pytest.raises(SystemExit) as caught:
        rc(["fmt", *arguments])
    assert caught.value.code == 2
    assert said in capsys.readouterr().err


def test_the_page_about_formatting_works_as_written(tmp_path: Path) -> None:
    done = list(steps(ROOT / "docs" / "guides" / "formatting.md"))
    assert len(done) > 4
    for step in done:
        do(step, tmp_path)
