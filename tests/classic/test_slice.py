"""IDSL as Slice: what it looks like, and what ZeroC's own compiler makes of it."""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from robocomp_py.contract.types import Primitive

from ..codegen.exported import SHIPPED_FILES, exported, in_format
from ..codegen.generated import MODELS
from ..dsl.announcements import announced, complaint

AWKWARD = """
import "Other.idsl";
module class
{
    interface Last extends First, Other::Far { void final(Later later, out Later value, int Object); };
    interface First { idempotent Later later(out int module, sequence<sequence<Later>> many) throws Worse; };
    struct Later { Mode exception = Mode::void; int class = 0x10; float f = .5f; string s = "a \\ b"; };
    enum Mode { void = 3, int, Mode };
    dictionary<Mode, sequence<string>> Words;
    sequence<Words> Texts;
    exception Bad { Other::Far2 far; int Bad; };
    exception Worse extends Bad { sequence<time> times; };
    const Mode usual = int;
    const uint32 most = 4294967295;
    const bool yes = true;
    const string backslash = "\\";
    struct Object { sequence<LocalObject> locals; };
    struct LocalObject { int x; };
    interface Seqs { sequence<int> IntSeq(sequence<int> other); Object object(LocalObject LocalObject); };
};
"""
OTHER = "module Other { struct Far2 { byte x = 255; }; interface Far { void Far2(Far2 Far2); Far2 other(); }; };"


@pytest.fixture
def awkward(tmp_path: Path) -> Path:
    (tmp_path / "Awkward.idsl").write_text(AWKWARD)
    (tmp_path / "Other.idsl").write_text(OTHER)
    return tmp_path / "Awkward.idsl"


def written(folder: Path, idsl: str) -> str:
    texts, _ = in_format(folder, idsl, "slice")
    return texts["X.ice"].partition("{\n")[2].rpartition("};\n\n#endif")[0]


def test_types_are_defined_before_they_are_used(tmp_path: Path) -> None:
    assert written(tmp_path, "module X { sequence<Point> Line; struct Point { float x; }; };") == (
        "    struct Point\n    {\n        float x;\n    };\n\n    sequence<Point> Line;\n"
    )


def test_outputs_stand_behind_inputs(tmp_path: Path) -> None:
    idsl = "module X { interface I { int f(out int a, int b, out int c, int d); }; };"
    assert "        int f(int b, int d, out int a, out int c);\n" in written(tmp_path, idsl)


def test_patterns_and_comments_become_comments(tmp_path: Path) -> None:
    idsl = """module X { interface I {
        // Stop at once.
        [command] void halt();
    }; };"""
    assert "        // [command] Stop at once.\n        void halt();\n" in written(tmp_path, idsl)


def test_sequences_in_place_get_names_that_are_free(tmp_path: Path) -> None:
    text = written(tmp_path, "module X { struct FloatSeq { sequence<sequence<float>> a; sequence<float> b; }; };")
    assert "sequence<float> FloatSeq2;\n    sequence<FloatSeq2> FloatSeq2Seq;\n" in text
    assert "        FloatSeq2Seq a;\n        FloatSeq2 b;\n" in text


@pytest.mark.parametrize("kind", Primitive)
def test_every_basic_type_has_a_word(kind: Primitive, tmp_path: Path) -> None:
    texts, _ = in_format(tmp_path, f"module RoboCompX {{ struct S {{ {kind} a; }}; }};", "slice")
    words = "bool|byte|short|int|long|float|double|string"
    assert re.search(rf"^ *({words}) a;", "\n".join(texts.values()), re.MULTILINE)


def test_widths_that_slice_lacks_become_wider_ones_and_say_so(tmp_path: Path) -> None:
    text = written(tmp_path, "module X { struct S { uint16 a; uint32 b = 4294967295; time c; int8 d = -1; }; };")
    assert "        int a;  // uint16\n        long b = 4294967295;  // uint32\n" in text
    assert "        long c;  // time: nanoseconds since 1970\n        byte d = 255;  // int8\n" in text


def test_what_is_imported_is_included_and_written_beside(awkward: Path) -> None:
    texts, report = exported(awkward, "slice")
    assert report.diagnostics == []
    assert '#include "Other.ice"' in texts["Awkward.ice"]
    assert "struct Far2" in texts["Other.ice"]


def test_underscores_are_allowed_in_a_file_that_has_some(tmp_path: Path) -> None:
    with_some, codes = in_format(tmp_path, "module X { struct S { int a_b; }; };", "slice")
    assert codes == []
    assert '[["underscore"]]' in with_some["X.ice"]
    without, _ = in_format(tmp_path, "module X { struct S { int ab; }; };  // a_b", "slice")
    assert "underscore" not in without["X.ice"]


@pytest.mark.parametrize("path", sorted((Path(__file__).parent / "errors" / "slice").glob("*.idsl")), ids=str)
def test_a_file_raises_what_it_announces(path: Path) -> None:
    _, report = exported(path, "slice")
    shown = "\n".join(each.render() for each in report.diagnostics)
    assert Counter(map(complaint, report.diagnostics)) == announced(path), shown


# What the compiler says.


def compiled(texts: dict[str, str], folder: Path) -> str:
    """What slice2py says of them."""
    said = ""
    folder.mkdir()
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name in texts:
        command = ["slice2py", "--output-dir", str(folder), str(folder / name)]
        done = subprocess.run(command, capture_output=True, text=True)
        said += done.stdout + done.stderr
        assert (done.returncode == 0) == (folder / f"{Path(name).stem}_ice.py").exists()
    return said


@pytest.mark.tool
@pytest.mark.parametrize("path", SHIPPED_FILES, ids=lambda path: path.stem)
def test_the_compiler_takes_every_interface_that_is_shipped(path: Path, tmp_path: Path) -> None:
    assert compiled(exported(path, "slice")[0], tmp_path / "ice") == ""


@pytest.mark.tool
def test_the_compiler_takes_names_that_are_words_of_slice(awkward: Path, tmp_path: Path) -> None:
    assert compiled(exported(awkward, "slice")[0], tmp_path / "ice") == ""


@pytest.mark.tool
def test_the_compiler_takes_all_types_and_patterns(tmp_path: Path) -> None:
    idsl = (MODELS / "Everything.idsl").read_text().replace("low = -1", "low = 1")
    idsl = idsl.replace("struct Nothing { };", "struct Nothing { int x; };")
    (tmp_path / "Shapes.idsl").write_text((MODELS / "Shapes.idsl").read_text())
    texts, codes = in_format(tmp_path, idsl, "slice")
    assert set(codes) == {"lossy-in-slice"}
    assert compiled(texts, tmp_path / "ice") == ""


@pytest.mark.tool
@pytest.mark.parametrize("name", ["Muñón", "2D", "robot arm-2"])
def test_the_compiler_takes_any_name_of_a_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"{name}.idsl"
    path.write_text("module X { struct S { int a; }; };")
    assert compiled(exported(path, "slice")[0], tmp_path / "ice") == ""


@pytest.mark.tool
def test_the_compiler_takes_enums_that_share_an_enumerator(tmp_path: Path) -> None:
    idsl = "module X { enum Hand { open, closed }; enum Door { locked, open }; struct S { Door door = open; }; };"
    texts, codes = in_format(tmp_path, idsl, "slice")
    assert codes == ["shared-enumerator"]
    assert compiled(texts, tmp_path / "ice") == ""


MISTAKES = (
    "struct S { };",
    "struct S { int _a; };",
    "struct S { int a_; };",
    "struct S { int a__b; };",
    "struct S { int iceberg; };",
    "struct Ptr { int a; };",
    "struct S { int a; int A; };",
    "struct S { int a; }; struct s { int a; };",
    "struct x { int a; };",
    "enum E { a = -1 };",
    "enum E { a, A };",
    "exception B { int a; }; exception C extends B { int A; };",
    "interface I { void i(); };",
    "interface I { void f(); void F(); };",
    "interface I { void f(int a, int A); };",
    "interface I { void f(); }; interface J extends I { void F(); };",
    "interface I { void f(); }; interface J { void F(); }; interface K extends I, J { };",
)


@pytest.mark.tool
@pytest.mark.parametrize("mistake", MISTAKES)
def test_the_compiler_refuses_what_is_said_not_to_be_slice(mistake: str, tmp_path: Path) -> None:
    texts, codes = in_format(tmp_path, f"module X {{ {mistake} }};", "slice")
    assert set(codes) == {"not-in-slice"}
    assert compiled(texts, tmp_path / "ice") != ""


def test_actions_are_left_out_with_a_warning(tmp_path: Path) -> None:
    idsl = "module X { interface I { [action] int goTo(float x) feedback(float left); void stop(); }; };"
    texts, codes = in_format(tmp_path, idsl, "slice")
    assert "goTo" not in texts["X.ice"]
    assert codes == ["lossy-in-slice"]
