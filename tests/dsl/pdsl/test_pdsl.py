"""What PDSL files mean."""

from __future__ import annotations

import pytest

from robocomp_py.contract.parameters import Parameter, ParameterKind, ParameterList, ParameterSet
from robocomp_py.dsl.diagnostics import Report
from robocomp_py.dsl.pdsl.parser import parse
from robocomp_py.dsl.source import Source

from ..texts import FOLDER, rendered, workspace


def parameters(text: str, **others: str) -> ParameterSet:
    found = workspace(arm_pdsl=text, **others)
    made = found.parameters(FOLDER / "arm.pdsl")
    assert made is not None, rendered(found)
    return made


def parameter(text: str) -> Parameter:
    [only] = parameters(f"ComponentParams arm {{\n{text}\n}};").parameters
    return only


INT, FLOAT, DOUBLE = ParameterKind.INT, ParameterKind.FLOAT, ParameterKind.DOUBLE
STRING, BOOL, ENUM = ParameterKind.STRING, ParameterKind.BOOL, ParameterKind.ENUM


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("x int 5;", Parameter("x", INT, 5)),
        ("x int -5 -10:0;", Parameter("x", INT, -5, -10, 0)),
        ("x int 0x10;", Parameter("x", INT, 16)),
        ("x float 1 0:10;", Parameter("x", FLOAT, 1.0, 0.0, 10.0)),
        ("x double .5e1;", Parameter("x", DOUBLE, 5.0)),
        ('x string "a b";', Parameter("x", STRING, "a b")),
        ("x string word;", Parameter("x", STRING, "word")),
        ('x string "";', Parameter("x", STRING, "")),
        ("x bool true;", Parameter("x", BOOL, True)),
        ("x bool false;", Parameter("x", BOOL, False)),
        ("x enum b { a, b };", Parameter("x", ENUM, "b", choices=("a", "b"))),
        ('x enum "b c" { a, "b c", 5, };', Parameter("x", ENUM, "b c", choices=("a", "b c", "5"))),
        ("x int 5 mandatory;", Parameter("x", INT, 5, mandatory=True)),
        ("x int 5 0:9 T;", Parameter("x", INT, 5, 0, 9, mandatory=True)),
        ("x int 5 0:9 dynamic;", Parameter("x", INT, 5, 0, 9, dynamic=True)),
        ("x bool true T dynamic;", Parameter("x", BOOL, True, mandatory=True, dynamic=True)),
        ("x bool true dynamic mandatory;", Parameter("x", BOOL, True, mandatory=True, dynamic=True)),
        ("x string dynamic dynamic;", Parameter("x", STRING, "dynamic", dynamic=True)),
        ("dynamic int 5 dynamic;", Parameter("dynamic", INT, 5, dynamic=True)),
        ("x enum a { a, b } T;", Parameter("x", ENUM, "a", choices=("a", "b"), mandatory=True)),
        ("x string T T;", Parameter("x", STRING, "T", mandatory=True)),
        ("T bool true T;", Parameter("T", BOOL, True, mandatory=True)),
        ("string string string;", Parameter("string", STRING, "string")),
    ],
)
def test_a_parameter_has_a_type_a_default_and_a_range(text: str, wanted: Parameter) -> None:
    found = parameter(text)
    assert found == wanted
    assert type(found.default) is type(wanted.default)


@pytest.mark.parametrize(
    "text", ['speed "m/s, forward" float 1;', "// m/s, forward\nspeed float 1;", "speed float 1;  // m/s, forward"]
)
def test_a_description_is_quoted_or_a_comment(text: str) -> None:
    assert parameter(text).description == "m/s, forward"


def test_the_file_of_2014_is_read() -> None:
    made = parameters(
        'ComponentParams sickLDComp{ device string "" T; startValue int 169 0:1000 T; angleRes float 1 0:10 T; };'
    )
    assert made == ParameterSet(
        "sickLDComp",
        (
            Parameter("device", STRING, "", mandatory=True),
            Parameter("startValue", INT, 169, 0, 1000, mandatory=True),
            Parameter("angleRes", FLOAT, 1.0, 0.0, 10.0, mandatory=True),
        ),
    )


def test_lists_nest_and_have_bounds() -> None:
    made = parameters(
        "ComponentParams arm { List motors [1:6] { id int 0; List gains { p float 1; } };"
        " speed float 1; List none { }; };"
    )
    gains = ParameterSet("gains", (Parameter("p", FLOAT, 1.0),))
    motors = ParameterSet("motors", (Parameter("id", INT, 0),), (ParameterList("gains", gains),))
    assert made == ParameterSet(
        "arm",
        (Parameter("speed", FLOAT, 1.0),),
        (ParameterList("motors", motors, 1, 6), ParameterList("none", ParameterSet("none"))),
    )


def test_a_list_has_a_description_too() -> None:
    made = parameters('ComponentParams arm { List motors "from the base on" [1:2] { id int 0; }; };')
    assert made.lists[0].description == "from the base on"


def test_imported_parameters_come_first_and_once() -> None:
    made = parameters(
        'import "left.pdsl"; import "right.pdsl"; ComponentParams arm { own int 1; };',
        left_pdsl='import "base.pdsl"; ComponentParams left { l int 1; };',
        right_pdsl='import "base"; ComponentParams right { r int 1; List rs { x int 1; }; };',
        base_pdsl="ComponentParams base { b int 1; };",
    )
    assert made.name == "arm"
    assert [each.name for each in made.parameters] == ["b", "l", "r", "own"]
    assert [each.name for each in made.lists] == ["rs"]


def test_what_is_wrong_in_an_imported_file_is_said_there() -> None:
    found = workspace(
        arm_pdsl='import "base.pdsl"; ComponentParams arm { };', base_pdsl="ComponentParams base { b int 5 6:7; };"
    )
    assert found.parameters(FOLDER / "arm.pdsl") is None
    assert [(each.code, each.span.source.path.name) for each in found.report.errors] == [("bad-default", "base.pdsl")]


def test_a_model_knows_where_everything_stands() -> None:
    text = "ComponentParams arm { speed float 1 0:2; List motors { id int 0; }; };"
    file = parse(Source(FOLDER / "arm.pdsl", text), Report())
    assert file is not None
    [speed], [motors] = file.scope.params, file.scope.lists
    assert file.scope.span.text == text
    assert (speed.span.text, motors.scope.span.text) == ("speed float 1 0:2;", "List motors { id int 0; };")
    assert [name.span.text for name in (speed.name, speed.default, *(speed.range or ()))] == ["speed", "1", "0", "2"]
