"""What IDSL files mean."""

from __future__ import annotations

import dataclasses

import pytest

from robocomp_py.contract import types as t
from robocomp_py.contract.interface import Interface, Pattern, Verb
from robocomp_py.contract.module import Constant
from robocomp_py.dsl.diagnostics import Report
from robocomp_py.dsl.idsl import model as m
from robocomp_py.dsl.idsl.parser import parse
from robocomp_py.dsl.source import Name, Source, Span

from ..texts import FOLDER, definition_of, interface_of, module_of

EVERYTHING = """
// Joints and how to move them.
import "Base.idsl";
module Arm
{
    const float pi = 3.14;
    enum Mode { off, on = 5, };
    // A joint.
    struct Joint { float angle = 1.5; /* in rad */ sequence<sequence<byte>> raw; }
    exception Broken extends Failed { string why; }
    exception Failed { };
    dictionary<string, Joint> ByName;
    sequence<Joint> Joints;
    interface Arm extends Limb
    {
        [query] idempotent Joints read(int from, out Mode mode) throws Broken, Failed;  // reads
        void move(Joints to, float speed = 1);
    };
    interface Limb { [command] void stop(); };
}
"""


def parsed(text: str = EVERYTHING) -> m.File:
    report = Report()
    file = parse(Source(FOLDER / "Arm.idsl", text), report)
    assert file is not None
    assert report.diagnostics == []
    return file


# Models.


def test_every_node_knows_where_it_stands() -> None:
    file = parsed()
    spans = {type(node).__name__: node.span.text for node in nodes(file) if hasattr(node, "span")}
    assert set(spans) == {
        *("Name", "Literal", "SequenceOf", "Const", "Enum", "Enumerator", "Struct", "Field", "Exception_"),
        *("Dictionary", "Sequence", "Interface", "Operation", "Param"),
    }
    assert spans["Const"] == "const float pi = 3.14;"
    assert spans["Enumerator"] == "on = 5"
    assert spans["SequenceOf"] == "sequence<byte>"
    assert spans["Operation"] == "[command] void stop();"
    assert spans["Param"] == "float speed = 1"
    assert spans["Interface"].startswith("interface Limb")


def test_every_name_is_the_text_of_its_span() -> None:
    names = [node for node in nodes(parsed()) if isinstance(node, Name)]
    assert len(names) > 30
    assert all(name.text == name.span.text for name in names)


def test_models_cannot_be_changed() -> None:
    for node in nodes(parsed()):
        assert dataclasses.is_dataclass(node)
        assert node.__dataclass_params__.frozen  # type: ignore[attr-defined]  # typeshed does not know it


def nodes(node: object) -> list[object]:
    """A model node and all below it."""
    if isinstance(node, tuple):
        return [each for item in node for each in nodes(item)]
    if not dataclasses.is_dataclass(node) or isinstance(node, Source | Span):
        return []
    inner = [getattr(node, field.name) for field in dataclasses.fields(node)]
    return [node, *(each for value in inner for each in nodes(value))]


# Types.


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("bool", t.BOOL),
        ("byte", t.UINT8),
        ("short", t.INT16),
        ("int", t.INT32),
        ("long", t.INT64),
        ("float", t.FLOAT32),
        ("double", t.FLOAT64),
        ("string", t.STRING),
        ("time", t.TIME),
        ("int8", t.INT8),
        ("uint8", t.UINT8),
        ("int16", t.INT16),
        ("uint16", t.UINT16),
        ("int32", t.INT32),
        ("uint32", t.UINT32),
        ("int64", t.INT64),
        ("uint64", t.UINT64),
        ("float32", t.FLOAT32),
        ("float64", t.FLOAT64),
    ],
)
def test_every_built_in_type_has_its_width(name: str, kind: t.Primitive) -> None:
    struct = definition_of(f"module Arm {{ struct S {{ {name} x; }}; }};", "S")
    assert struct == t.Struct("Arm::S", (t.Field("x", kind),))


def test_names_are_qualified_and_resolved() -> None:
    module = module_of(
        'import "Base.idsl"; module Arm { struct Pair { Base::Mode a; Arm::Joint b; Joint c; };'
        " struct Joint { float x; }; };",
        Base_idsl="module Base { enum Mode { off, on }; };",
    )
    joint = t.Struct("Arm::Joint", (t.Field("x", t.FLOAT32),))
    mode = t.Enumeration("Base::Mode", (("off", 0), ("on", 1)))
    pair = t.Struct("Arm::Pair", (t.Field("a", mode), t.Field("b", joint), t.Field("c", joint)))
    assert module.definitions == (joint, pair), "each after those it uses"


def test_sequences_and_dictionaries_nest() -> None:
    text = "module Arm { sequence<sequence<sequence<float>>> Cube; dictionary<Mode, Cube> Cubes; enum Mode { off }; };"
    cube = t.Sequence(t.Sequence(t.Sequence(t.FLOAT32)))
    assert definition_of(text, "Cube") == cube
    assert definition_of(text, "Cubes") == t.Dictionary(t.Enumeration("Arm::Mode", (("off", 0),)), cube)


def test_enumerators_count_from_the_one_before() -> None:
    mode = definition_of("module Arm { enum Mode { a = 1, b = 5, c, d = -1, e, f = 007, g = 0x1F }; };", "Mode")
    assert isinstance(mode, t.Enumeration)
    assert [value for _, value in mode.members] == [1, 5, 6, -1, 0, 7, 31]


def test_structs_and_exceptions_may_be_empty() -> None:
    module = module_of("module Arm { struct S { }; exception E { }; };")
    assert module.definitions == (t.Struct("Arm::S", ()), t.ExceptionType("Arm::E", ()))


def test_exceptions_know_their_bases() -> None:
    text = "module Arm { exception A extends B { int a; }; exception B { int b; }; };"
    found = definition_of(text, "A")
    assert isinstance(found, t.ExceptionType)
    assert found.lineage == ("Arm::A", "Arm::B")
    assert [field.name for field in found.all_fields] == ["b", "a"]


@pytest.mark.parametrize(
    ("declared", "value"),
    [
        ("int x = -5", -5),
        ("int x = 007", 7),
        ("byte x = 0xFF", 255),
        ("float x = 1.5f", 1.5),
        ("double x = .5e3", 500.0),
        ("float x = 2", 2.0),
        ("bool x = true", True),
        ('string x = "a // b"', "a // b"),
        ("time x = 1700000000000000000", 1_700_000_000_000_000_000),
        ("Mode x = on", "on"),
        ("Mode x = Mode::on", "on"),
        ("Mode x = Arm::Mode::on", "on"),
    ],
)
def test_fields_constants_and_parameters_have_values_of_their_type(declared: str, value: object) -> None:
    module = module_of(
        f"module Arm {{ enum Mode {{ off, on }}; struct S {{ {declared}; }}; const {declared};"
        f" interface I {{ void f({declared}); }}; }};"
    )
    _, struct, constant, interface = module.definitions
    assert isinstance(struct, t.Struct)
    assert isinstance(constant, Constant)
    assert isinstance(interface, Interface)
    assert [struct.fields[0].default, constant.value, interface.operations[0].inputs[0].default] == [value] * 3


# Operations.


def test_an_operation_knows_its_inputs_outputs_and_exceptions() -> None:
    [operation] = interface_of(
        "module Arm { exception Broken { string why; };"
        " interface Arm { idempotent int move(float to, out bool done, string how, out string why) throws Broken; }; };"
    ).operations
    assert operation.interface == "Arm::Arm"
    assert operation.inputs == (t.Field("to", t.FLOAT32), t.Field("how", t.STRING))
    assert operation.outputs == (t.Field("ret", t.INT32), t.Field("done", t.BOOL), t.Field("why", t.STRING))
    assert [each.name for each in operation.raises] == ["Arm::Broken"]
    assert operation.idempotent


@pytest.mark.parametrize("pattern", [*Pattern, None])
def test_a_pattern_is_what_the_file_says(pattern: Pattern | None) -> None:
    annotation = f"[{pattern}]" if pattern else ""
    [operation] = interface_of(f"module Arm {{ interface Arm {{ {annotation} void f(); }}; }};").operations
    assert operation.pattern == pattern


def test_without_a_pattern_the_verb_decides() -> None:
    interface = interface_of("module Arm { interface Arm { void tell(int x); int ask(); }; };")
    assert [(o.name, p) for o, p in interface.under(Verb.REQUIRES)] == [("tell", "query"), ("ask", "query")]
    assert [(o.name, p) for o, p in interface.under(Verb.PUBLISHES)] == [("tell", "publish")]


def test_the_example_of_the_paper_is_understood_as_printed() -> None:
    [operation] = interface_of(
        "module Arm { struct datasayin { string text; }; struct dataresponse { bool ok; };"
        " interface Arm { [query]void say(datasayin pin,out dataresponse pout); }; };"
    ).operations
    assert operation.pattern is Pattern.QUERY
    assert [field.name for field in operation.inputs] == ["pin"]
    assert [field.name for field in operation.outputs] == ["pout"]
    assert operation.source == "[query]void say(datasayin pin,out dataresponse pout)"


def test_a_declaration_is_quoted_without_its_comments() -> None:
    [operation] = interface_of(
        "module Arm { interface Arm {\n  void f(int a,  // the first\n         int b /* the second */);\n}; };"
    ).operations
    assert operation.source == "void f(int a, int b)"


def test_inherited_operations_come_first_and_belong_to_the_interface() -> None:
    interface = interface_of(
        "module Arm { interface Arm extends Left, Right { void own(); };"
        " interface Left extends Root { void left(); }; interface Right extends Root { void right(); };"
        " interface Root { void root(); }; };"
    )
    assert [(o.interface, o.name) for o in interface.operations] == [
        ("Arm::Arm", "root"),
        ("Arm::Arm", "left"),
        ("Arm::Arm", "right"),
        ("Arm::Arm", "own"),
    ]


def test_keywords_are_names_where_they_cannot_be_keywords() -> None:
    module = module_of(
        "module module { struct struct { int sequence; enum enum; }; enum enum { query, out };"
        " interface interface { void idempotent(int out, int throws); }; };"
    )
    assert [each.name for each in module.definitions] == ["module::enum", "module::struct", "module::interface"]


# Comments.


@pytest.mark.parametrize(
    ("comment", "doc"),
    [
        ("// What it does.\n", "What it does."),
        ("// One line,\n// and another.\n", "One line,\nand another."),
        ("/** What it does. */\n", "What it does."),
        ("/*\n * What it does.\n */\n", "What it does."),
        ("/// \\brief What it does.\n", "What it does."),
        ("/** @brief Moves.\n @param x where to\n @return how far */\n", "Moves.\nParam x where to\nReturn how far"),
        ("// About something else.\n\n", ""),
    ],
)
def test_a_comment_above_documents_what_it_stands_above(comment: str, doc: str) -> None:
    module = module_of(f"module Arm {{\n{comment}struct S {{ int x; }};\n}};")
    [struct] = module.definitions
    assert isinstance(struct, t.Struct)
    assert struct.doc == doc


def test_a_comment_behind_documents_what_it_stands_behind() -> None:
    struct = definition_of(
        "module Arm { struct S {\n int x; // first\n int y; /* second */ int z;\n int w;\n // none\n\n int v;\n}; };",
        "S",
    )
    assert isinstance(struct, t.Struct)
    assert [field.doc for field in struct.fields] == ["first", "second", "", "", ""]


def test_documentation_does_not_change_what_an_operation_means() -> None:
    plain = "module Arm { struct S { int x; }; interface Arm { S f(); }; };"
    documented = plain.replace("struct", "// A struct.\nstruct").replace("S f", "// An operation.\nS f")
    one, other = interface_of(plain).operations[0], interface_of(documented).operations[0]
    assert one == other
    assert one.fingerprint == other.fingerprint


def test_an_operation_may_want_a_confirmation_which_is_no_part_of_the_contract() -> None:
    text = "module M {{ interface I {{ {} void stop(int confirm); [action] {} int dock(); }}; }};"
    marked, plain = (interface_of(text.format(mark, mark), "I") for mark in ("[confirm]", ""))
    assert [each.operations[0].confirm for each in (marked, plain)] == [True, False]
    assert [each.actions[0].start.confirm for each in (marked, plain)] == [True, False]
    assert marked.operations[0].fingerprint == plain.operations[0].fingerprint
    assert marked.actions[0].start.fingerprint == plain.actions[0].start.fingerprint
