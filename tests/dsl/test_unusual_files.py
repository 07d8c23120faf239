"""Whatever a file holds, and whatever is wrong with it: a diagnostic, never a traceback."""

from __future__ import annotations

import gc
import os
import random
from pathlib import Path

import pytest

from robocomp_py.dsl.diagnostics import Diagnostic
from robocomp_py.dsl.syntax import MAX_CHARACTERS
from robocomp_py.dsl.workspace import ENDINGS, Workspace

pytestmark = pytest.mark.usefixtures("standard_folders_are_empty")

EMPTY = {
    ".idsl": "module Arm { };",
    ".cdsl": "Component arm { language python; };",
    ".pdsl": "ComponentParams arm { };",
    ".ddsl": "Deployment arm { };",
    ".smdsl": "arm { initial_state a; };",
}
"""The least there can be in a file of each language."""


def lint(path: Path) -> list[Diagnostic]:
    workspace = Workspace()
    workspace.check(path)
    for each in workspace.report.diagnostics:
        assert each.render()
        assert each.to_json()
    return workspace.report.diagnostics


def codes(path: Path) -> list[str]:
    return [each.code for each in lint(path)]


@pytest.fixture(params=ENDINGS)
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A file of each language that is not there yet."""
    return tmp_path / f"arm{request.param}"


def test_a_file_that_is_not_there_is_unreadable(path: Path) -> None:
    assert codes(path) == ["unreadable"]


def test_a_folder_with_the_name_of_a_file_is_unreadable(path: Path) -> None:
    path.mkdir()
    assert codes(path) == ["unreadable"]


def test_a_file_of_a_folder_is_named_in_its_place(tmp_path: Path) -> None:
    (tmp_path / "arm").mkdir()
    assert [each.hint for each in lint(tmp_path / "arm")] == ["give a file"]
    (tmp_path / "arm" / "arm.cdsl").touch()
    assert [each.hint for each in lint(tmp_path / "arm")] == [f"give a file, as `{tmp_path / 'arm' / 'arm.cdsl'}`"]


def test_a_link_to_itself_is_unreadable(path: Path) -> None:
    path.symlink_to(path)
    assert codes(path) == ["unreadable"]


def test_a_pipe_is_unreadable_and_not_waited_for(path: Path) -> None:
    os.mkfifo(path)
    assert codes(path) == ["unreadable"]


def test_what_the_disk_refuses_is_said_in_its_words(path: Path) -> None:
    def read(_: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    workspace = Workspace(read=read)
    workspace.check(path)
    assert workspace.report.errors[0].message == "cannot be read: Permission denied"


def test_the_least_there_can_be_is_fine(path: Path) -> None:
    path.write_text(EMPTY[path.suffix])
    assert codes(path) == []


def test_dos_line_ends_and_a_byte_order_mark_are_fine(path: Path) -> None:
    text = EMPTY[path.suffix].replace(" ", "\r\n")
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert codes(path) == []


def test_a_closing_brace_needs_no_semicolon(path: Path) -> None:
    path.write_text(EMPTY[path.suffix].replace("};", "}"))
    assert codes(path) == []


@pytest.mark.parametrize("data", [b"", b" \r\n\t", b"\xef\xbb\xbf", b"// nothing"], ids=["empty", "blank", "BOM", "//"])
def test_a_file_with_nothing_in_it_is_said_to_be_so(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    [found] = lint(path)
    assert found.message.startswith("there is nothing in this file; expected ")


def test_latin_1_is_read_with_a_warning(path: Path) -> None:
    path.write_bytes("// ñandú\n".encode("latin-1") + EMPTY[path.suffix].encode())
    [found] = lint(path)
    assert (found.code, found.span.source.position(found.span.start)) == ("not-utf8", (1, 4))


def test_utf_16_is_called_by_its_name(path: Path) -> None:
    path.write_text(EMPTY[path.suffix], encoding="utf-16")
    [found] = lint(path)
    assert (found.code, found.message) == ("not-utf8", "this is UTF-16")


def test_semicolons_too_many_are_no_error_however_many_there_are(path: Path) -> None:
    path.write_text(EMPTY[path.suffix].replace("{", "{;;").replace("};", "};;\n;") + "; " * 100)
    found = lint(path)
    assert {(each.severity, each.code) for each in found} == {("warning", "stray-semicolon")}
    assert len(found) <= 20
    path.write_text("".join(f"enum E{n} {{ a{n} }};;\n" for n in range(100)).join(["module Arm {\n", "};"]))
    workspace = Workspace()
    assert path.suffix != ".idsl" or workspace.interfaces(path) is not None


@pytest.mark.parametrize("seed", range(5))
def test_binary_garbage_is_an_error_that_does_not_disturb_a_terminal(path: Path, seed: int) -> None:
    path.write_bytes(random.Random(seed).randbytes(5000))
    found = lint(path)
    assert any(each.severity == "error" for each in found)
    assert all(char.isprintable() or char in "\n\t" for each in found for char in each.render())


def test_a_file_of_zeros_is_an_error(path: Path) -> None:
    path.write_bytes(bytes(1000))
    assert "syntax" in codes(path)


def test_a_huge_file_is_refused_without_being_parsed(path: Path) -> None:
    path.write_text(EMPTY[path.suffix] + " " * MAX_CHARACTERS)
    assert codes(path) == ["too-large"]


def test_a_file_of_fifty_thousand_lines_is_read(tmp_path: Path) -> None:
    lines = "".join(f"    struct Joint{number}\n    {{\n        float angle;\n    }};\n" for number in range(12_500))
    path = tmp_path / "Arm.idsl"
    path.write_text(f"module Arm\n{{\n{lines}}};\n")
    module = Workspace().interfaces(path)
    assert module is not None
    assert len(module.definitions) == 12_500


def test_garbage_is_collected_afterwards_if_it_was_before(path: Path) -> None:
    path.write_text(EMPTY[path.suffix])
    assert gc.isenabled()
    lint(path)
    assert gc.isenabled()
    gc.disable()
    try:
        lint(path)
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_of_an_endless_file_only_so_much_is_read() -> None:
    workspace = Workspace()
    source = workspace.source(Path("/dev/zero"))
    assert source is not None
    assert len(source.text) < 5 * MAX_CHARACTERS


@pytest.mark.parametrize("opening", ["{", "<", "(", "seq<", "a {"])
def test_nesting_a_hundred_thousand_deep_is_refused(path: Path, opening: str) -> None:
    path.write_text(EMPTY[path.suffix].replace("{", "{" + opening * (100_000)))
    assert codes(path)[-1] == "too-deep"


@pytest.mark.parametrize("text", ["}", "};", "/", '"', "/*", "#\n", "\\", ";", "{}", "a ", "(", ")", ":", "0", "-"])
def test_many_of_anything_end_in_a_few_diagnostics(path: Path, text: str) -> None:
    path.write_text(EMPTY[path.suffix].replace("{", "{" + text * 20_000))
    assert 1 <= len(codes(path)) <= 20


def test_a_message_about_a_very_long_line_shows_a_part_of_it(path: Path) -> None:
    path.write_text(EMPTY[path.suffix] + " " * 100_000 + "?" + " " * 100_000)
    [found] = lint(path)
    assert max(map(len, found.render().splitlines())) < 200
    excerpt, caret = found.render().splitlines()[1:3]
    assert excerpt[caret.index("^")] == "?"


def test_of_many_misspelt_types_only_the_first_get_proposals(tmp_path: Path) -> None:
    """Each is compared with all names there are: for thousands of them, that would take minutes."""
    types = "".join(f"    struct Joint{number} {{ Jointt{number} x; }};\n" for number in range(1000))
    path = tmp_path / "Arm.idsl"
    path.write_text(f"module Arm\n{{\n{types}}};\n")
    found = lint(path)
    assert [each.code for each in found] == ["unknown-type"] * 1000
    assert [number for number, each in enumerate(found) if each.hint] == list(range(20))


def test_of_many_misspelt_interfaces_only_the_first_get_proposals(tmp_path: Path) -> None:
    path = tmp_path / "arm.cdsl"
    uses = ", ".join(f"Lase{number}r" for number in range(1000))
    path.write_text(f"Component arm {{ Communications {{ requires {uses}; }}; language python; }};")
    found = lint(path)
    assert [each.code for each in found] == ["unknown-interface"] * 1000
    assert [number for number, each in enumerate(found) if each.hint] == list(range(20))


@pytest.mark.parametrize("kind", ["interface", "exception"])
def test_a_very_long_line_of_ancestors_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "Arm.idsl"
    for length, said in ((90, set()), (1000, {"too-deep"})):
        heirs = "".join(f"{kind} E{number} extends E{number + 1} {{ }};\n" for number in range(length))
        path.write_text(f"module Arm {{ {heirs} {kind} E{length} {{ }}; }};")
        assert set(codes(path)) == said


@pytest.mark.parametrize(
    ("written", "proposed"),
    [
        ("yard", "yard.ddsl"),
        ("pilot", "pilot.cdsl"),
        ("pilt", "pilot"),
        ("yrd", ""),
        ("yard.dsl", "yard.ddsl"),
        ("pilot.cdls", "pilot.cdsl"),
        ("yard.xml", ""),
    ],
)
def test_for_a_name_without_an_ending_or_with_a_misspelt_one_a_model_or_a_folder_is_proposed(
    written: str, proposed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for each in ("yard.cdsl", "yard.ddsl", "pilot.cdsl"):
        Path(each).touch()
    Path("pilot").mkdir()
    workspace = Workspace()
    assert workspace.source(Path(written)) is None
    assert workspace.report.errors[0].hint == (f"did you mean `{proposed}`?" if proposed else "")
