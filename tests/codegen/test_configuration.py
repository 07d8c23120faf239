"""The configuration that is written for a component passes the component's own check."""

from __future__ import annotations

import tomllib
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.codegen.configuration import toml_params
from robocomp_py.contract.parameters import (
    Parameter,
    ParameterKind,
    ParameterList,
    ParameterSet,
    check,
    flat,
)

Texts = st.text(max_size=12).filter(lambda text: not any(0xD800 <= ord(char) < 0xE000 for char in text))
Names = st.from_regex(r"[a-z][a-z0-9_]{0,6}", fullmatch=True)


@st.composite
def numbers(draw: Any) -> tuple[ParameterKind, Any, Any, Any]:
    kind = draw(st.sampled_from([ParameterKind.INT, ParameterKind.FLOAT, ParameterKind.DOUBLE]))
    values = st.integers(-(2**40), 2**40) if kind is ParameterKind.INT else st.floats(-1e30, 1e30)
    low, default, high = sorted(draw(st.lists(values, min_size=3, max_size=3)))
    return (kind, default, low, high) if draw(st.booleans()) else (kind, default, None, None)


@st.composite
def parameters(draw: Any, name: str) -> Parameter:
    rest = {"mandatory": draw(st.booleans()), "dynamic": draw(st.booleans()), "description": draw(Texts)}
    match draw(st.sampled_from(["number", "text", "bool", "enum"])):
        case "number":
            return Parameter(name, *draw(numbers()), **rest)
        case "text":
            return Parameter(name, ParameterKind.STRING, draw(Texts), **rest)
        case "bool":
            return Parameter(name, ParameterKind.BOOL, draw(st.booleans()), **rest)
    choices = tuple(draw(st.lists(Texts, min_size=1, max_size=3, unique=True)))
    return Parameter(name, ParameterKind.ENUM, draw(st.sampled_from(choices)), choices=choices, **rest)


@st.composite
def sets(draw: Any, depth: int = 2) -> ParameterSet:
    names = draw(st.lists(Names, min_size=1, max_size=4, unique=True))
    number = draw(st.integers(0, min(2, len(names) - 1))) if depth else 0
    lists = []
    for name in names[:number]:
        minimum = draw(st.integers(0, 2))
        maximum = draw(st.none() | st.integers(max(minimum, 1), 4))
        lists.append(ParameterList(name, draw(sets(depth - 1)), minimum, maximum, draw(Texts)))
    return ParameterSet("any", tuple(draw(parameters(name)) for name in names[number:]), tuple(lists))


@given(sets())
def test_the_configuration_that_is_written_is_right_and_holds_the_defaults(params: ParameterSet) -> None:
    written = tomllib.loads(f"[params]\n{toml_params(params)}\n")
    values, complaints = check(params, written["params"])
    assert complaints == []
    for _, parameter, value in flat(params, values):
        assert value == parameter.default
    for each in params.lists:
        assert len(values[each.name]) == each.minimum
