"""IDSL as OMG IDL: what is in it, and what the compiler of Debian's Cyclone DDS makes of it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from .descriptions import of_idl
from .exported import SHIPPED_FILES, exported, in_format
from .generated import MODELS


def test_an_operation_becomes_what_travels_for_it(tmp_path: Path) -> None:
    idsl = """module X { exception Bad { int a; }; interface I {
        [query] int ask(int a, out int b) throws Bad; [command] void go(int c); [publish] void said(int d);
        void either(int e); }; };"""
    texts, _ = in_format(tmp_path, idsl, "omgidl")
    assert of_idl(texts) == {
        "X::Bad": (("a", "int32"),),
        "X::IAskRequest": (("a", "int32"),),
        "X::IAskResponse": (("ret", "int32"), ("b", "int32")),
        "X::IGoRequest": (("c", "int32"),),
        "X::ISaidPublication": (("d", "int32"),),
        "X::IEitherPublication": (("e", "int32"),),
        "X::IEitherRequest": (("e", "int32"),),
        "X::IEitherResponse": (("structure_needs_at_least_one_member", "uint8"),),
    }
    assert "// I.ask, answered. Throws Bad." in texts["X.idl"]


def test_constants_are_constants(tmp_path: Path) -> None:
    idsl = """module X { enum E { a = 3 }; const E usual = a; const bool yes = true; const string s = "a\\b";
        const int64 least = -9223372036854775808; const time never = 5; };"""
    texts, codes = in_format(tmp_path, idsl, "omgidl")
    assert codes == ["lossy-in-omgidl"]
    lines = [line.strip() for line in texts["X.idl"].splitlines() if " const " in line]
    assert lines == [
        "const int32 usual = 3;",
        "const boolean yes = TRUE;",
        'const string s = "a\\\\b";',
        "const int64 least = -9223372036854775808;",
        "const int64 never = 5;",
        "const int32 a = 3;",
    ]


def compiled(texts: dict[str, str], folder: Path) -> str:
    """What idlc says of them."""
    said = ""
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name in texts:
        command = ["idlc", "-f", "case-sensitive", "-l", "c", "-o", str(folder), str(folder / name)]
        done = subprocess.run(command, capture_output=True, text=True)
        said += done.stdout + done.stderr
    return said


@pytest.mark.tool
@pytest.mark.parametrize("path", [*SHIPPED_FILES, MODELS / "Everything.idsl"], ids=lambda path: path.stem)
def test_the_compiler_takes_every_interface(path: Path, tmp_path: Path) -> None:
    texts, report = exported(path, "omgidl")
    assert report.errors == []
    assert compiled(texts, tmp_path) == ""


@pytest.mark.tool
@pytest.mark.parametrize("mistake", ["struct S { int S; };", "struct X { int a; };"])
def test_the_compiler_refuses_what_is_said_not_to_be_idl(mistake: str, tmp_path: Path) -> None:
    texts, codes = in_format(tmp_path, f"module X {{ {mistake} }};", "omgidl")
    assert codes == ["not-in-omgidl"]
    assert compiled(texts, tmp_path) != ""


@pytest.mark.tool
def test_the_compiler_takes_constants(tmp_path: Path) -> None:
    idsl = 'module X { const string s = "a\\b"; const bool no = false; const double d = 1e-3; const byte b = 255; };'
    assert compiled(in_format(tmp_path, idsl, "omgidl")[0], tmp_path) == ""
