"""Any message: types made of all there are, and values that fit them."""

from __future__ import annotations

import os
from dataclasses import make_dataclass
from enum import IntEnum
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INTEGERS,
    STRING,
    TIME,
    Dictionary,
    Enumeration,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
    integer_range,
)

MANY = int(os.environ.get("ROBOCOMP_FUZZ", "40"))

patiently = settings(deadline=None, max_examples=MANY, suppress_health_check=[HealthCheck.too_slow])
"""How properties of any message are tested: a loaded machine is no failure. `make fuzz` tries thousands."""

DEPTH = 4
INT32_RANGE = integer_range(Primitive.INT32)

# Python's keywords among them, as IDSL files have them.
_NAMES = st.sampled_from(["x", "y", "angle", "lambda", "class", "None", "data_2", "N", "self", "values", "frames"])


@st.composite
def messages(draw: st.DrawFn) -> tuple[Struct, tuple[Any, ...]]:
    """A message type, and one message of it."""
    message = draw(message_types())
    return message, draw(st.tuples(*(values(field.type) for field in message.fields)))


@st.composite
def message_types(draw: st.DrawFn) -> Struct:
    return Struct("Any::Message", draw(_fields(DEPTH, [0])))


@st.composite
def _fields(draw: st.DrawFn, depth: int, count: list[int]) -> tuple[Field, ...]:
    names = draw(st.lists(_NAMES, max_size=4, unique=True))
    return tuple(Field(name, draw(_types(depth - 1, count))) for name in names)


def _types(depth: int, count: list[int]) -> st.SearchStrategy[Any]:
    """Types; `count` makes their names unique."""
    flat = st.one_of(st.sampled_from(list(Primitive)), _enumerations(count))
    arrays = st.builds(Sequence, st.sampled_from([kind for kind in Primitive if kind not in (STRING, TIME)]))
    if depth <= 0:
        return st.one_of(flat, arrays)
    keys = st.one_of(st.sampled_from([BOOL, STRING, *sorted(INTEGERS)]), _enumerations(count))
    inner = st.deferred(lambda: _types(depth - 1, count))
    return st.one_of(
        flat, arrays, _structs(depth, count), st.builds(Sequence, inner), st.builds(Dictionary, keys, inner)
    )


@st.composite
def _structs(draw: st.DrawFn, depth: int, count: list[int]) -> Struct:
    count[0] += 1
    name = f"S{count[0]}"
    fields = draw(_fields(depth, count))
    python = make_dataclass(name, [(f.attribute, object) for f in fields], slots=draw(st.booleans()))
    return Struct(f"Any::{name}", fields, python)


@st.composite
def _enumerations(draw: st.DrawFn, count: list[int]) -> Enumeration:
    count[0] += 1
    name = f"E{count[0]}"
    numbers = draw(st.lists(st.integers(*INT32_RANGE), min_size=1, max_size=4, unique=True))
    members = tuple((f"m{place}", number) for place, number in enumerate(numbers))
    python = IntEnum(name, members) if draw(st.booleans()) else None
    return Enumeration(f"Any::{name}", members, python)


def values(kind: Type) -> st.SearchStrategy[Any]:
    """Values of a type, in the form in which they are received."""
    match kind:
        case Struct(fields=fields, python=python):
            inside = [values(field.type) for field in fields]
            return st.builds(python, *inside) if python else st.tuples(*inside)
        case Enumeration(members=members, python=python):
            return st.sampled_from([python(number) if python else number for _, number in members])
        case Sequence(item):
            if kind.dtype is not None:
                return npst.arrays(kind.dtype, st.integers(0, 20))
            return st.lists(values(item), max_size=4)
        case Dictionary(key, item):
            return st.dictionaries(values(key), values(item), max_size=4)
        case Primitive():
            return _SCALARS[kind]


_SCALARS: dict[Primitive, st.SearchStrategy[Any]] = {
    BOOL: st.booleans(),
    STRING: st.text(),
    FLOAT32: st.floats(width=32),
    FLOAT64: st.floats(),
    **{kind: st.integers(*integer_range(kind)) for kind in Primitive if kind.python is int},
}
