"""Parts of messages and conditions on them, and what is said if they do not fit a contract."""

from __future__ import annotations

import re
from typing import Any

import pytest

from robocomp_py.contract import types as t
from robocomp_py.contract.types import BOOL, FLOAT32, INT32, STRING, TIME, UINT8, Enumeration, Field, Struct
from robocomp_py.tools.parts import condition, parts

COLOUR = Enumeration("Home::Colour", (("warm", 0), ("cold", 1)))
ECHO = Struct("Home::Echo", (Field("angle", FLOAT32), Field("dist", FLOAT32)))
LIGHT = Struct(
    "Home::Light",
    (
        Field("on", BOOL),
        Field("colour", COLOUR),
        Field("power", FLOAT32),
        Field("name", STRING),
        Field("at", TIME),
        Field("nearest", ECHO),
        Field("scan", t.Sequence(ECHO)),
        Field("rows", t.Sequence(t.Sequence(INT32))),
        Field("picture", t.Sequence(UINT8)),
        Field("levels", t.Dictionary(STRING, INT32)),
    ),
)
INPUTS = (Field("light", LIGHT), Field("number", INT32))

MESSAGE: dict[str, Any] = {
    "light": {
        "on": True,
        "colour": "cold",
        "power": 7.5,
        "name": "hall > cellar",
        "at": 10**18,
        "nearest": {"angle": 0.5, "dist": 2.0},
        "scan": [{"angle": 0.0, "dist": 1.0}, {"angle": 0.1, "dist": "NaN"}, {"angle": 0.2, "dist": 4.0}],
        "rows": [[1, 2], [], [3]],
        "picture": "AAEC",
        "levels": {"low": 3, "7": 8},
    },
    "number": 4,
}


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("number", 4),
        ("light.nearest", {"angle": 0.5, "dist": 2.0}),
        ("light.scan[2].dist", 4.0),
        ("light.scan[*].dist", [1.0, "NaN", 4.0]),
        ("light.rows[*][0]", [1, None, 3]),
        ("light.rows[*][*]", [[1, 2], [], [3]]),
        ("light.rows[7][0]", None),
        ("light.picture", "AAEC"),
        ("light.levels.low", 3),
        ("light.levels[7]", 8),
        ("light.levels.high", None),
    ],
)
def test_a_path_names_a_part(path: str, value: object) -> None:
    (part,) = parts(INPUTS, path)
    assert part.of(MESSAGE) == value
    assert part.path == path


def test_a_star_names_all_fields_of_a_struct_one_by_one() -> None:
    assert {each.path: each.of(MESSAGE) for each in parts(INPUTS, "light.nearest.*")} == {
        "light.nearest.angle": 0.5,
        "light.nearest.dist": 2.0,
    }
    assert [each.path for each in parts(INPUTS, "*")][-4:] == [
        "light.rows",
        "light.picture",
        "light.levels",
        "number",
    ]
    assert {each.path: each.of(MESSAGE) for each in parts(INPUTS, "light.scan[*].*")} == {
        "light.scan[*].angle": [0.0, 0.1, 0.2],
        "light.scan[*].dist": [1.0, "NaN", 4.0],
    }


def test_the_name_of_an_only_parameter_may_be_left_out() -> None:
    (part,) = parts(INPUTS[:1], "nearest.dist")
    assert (part.path, part.of(MESSAGE)) == ("light.nearest.dist", 2.0)


@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("light.", "`light.` is no path; write it as a.b, a[0].b, a[*].b for all items, or a.* for all fields"),
        ("light.*.on", "is no path"),
        ("light.powr", "`light`: unknown field `powr`; did you mean `power`?"),
        ("lamp", "unknown field `lamp`; known: light, number"),
        ("light.scan.dist", "`light.scan` is a sequence; write light.scan[0].dist"),
        ("light.scan.*", "`light.scan` is a sequence; write light.scan[0].*"),
        ("light.nearest[*]", "`light.nearest` is Home.Echo, and has no items"),
        ("number.*", "`number` is int32, and has no fields"),
        ("light.picture[0]", "`light.picture` holds octets, which are shown in base64 as a whole"),
    ],
)
def test_a_path_that_does_not_fit_is_told(path: str, why: str) -> None:
    with pytest.raises(ValueError, match=re.escape(why)):
        parts(INPUTS, path)


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        ("light.power>3", True),
        ("light.power > 7.5", False),
        ("light.power>=7.5", True),
        ("light.power<7.5", False),
        ("light.power <= 1e9", True),
        ("number=4", True),
        ("number==4", True),
        ("number!=4", False),
        ("number<4.5", True),
        ("light.at>999999999999999999", True),
        ("light.on=true", True),
        ("light.on != true", False),
        ("light.colour=cold", True),
        ("light.colour=warm", False),
        ("light.name=hall > cellar", True),
        ('light.name="hall > cellar"', True),
        ("light.name!=attic", True),
        ("light.scan[1].dist>0", False),
        ("light.scan[*].dist>3", True),
        ("light.scan[*].dist>4", False),
        ("light.scan[9].dist>0", False),
        ("light.rows[*][*]=3", True),
        ("light.levels.low=3", True),
        ("light.levels.high!=3", False),
    ],
)
def test_a_condition(text: str, fits: bool) -> None:
    assert condition(INPUTS, text).fits(MESSAGE) is fits


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("light.power", "`light.power` is no condition; write a path, one of = != < <= > >=, and a value: a.b>3"),
        ("light.power>much", "`light.power` is float32; compare it with a number, and not `much`"),
        ("light.power>__import__('os')", "compare it with a number"),
        ("number=true", "`number` is int32; compare it with a number, and not `true`"),
        ("light.power=nan", "compare it with a number"),
        ("light.powr>3", "`light`: unknown field `powr`; did you mean `power`?"),
        ("light.on=yes", "`light.on` is true or false, and not `yes`"),
        ("light.on>false", "`light.on` is bool; compare it by = or !="),
        ("light.colour=cld", "`light.colour` is one of warm, cold, and not `cld`"),
        ("light.name<b", "`light.name` is string; compare it by = or !="),
        ('light.name="b', '`"b` is no text in quotes'),
        ("light.nearest=3", "`light.nearest` is Home.Echo, and is not compared"),
        ("light.rows[0]>3", "compare one of its items, light.rows[0][0], or any of them, light.rows[0][*]"),
        ("light.picture=AA", "`light.picture` is a sequence of uint8, and is not compared"),
        ("light.*>3", "`light.*` names several fields; compare one of them"),
    ],
)
def test_a_condition_that_does_not_fit_is_told(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=re.escape(why)):
        condition(INPUTS, text)
