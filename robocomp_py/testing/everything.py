"""An interface that uses every type and every pattern, as rcgen would have generated it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..contract.interface import Interface, Operation, Pattern
from ..contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT8,
    INT16,
    INT32,
    INT64,
    STRING,
    TIME,
    UINT8,
    UINT16,
    UINT32,
    UINT64,
    Dictionary,
    Enumeration,
    ExceptionType,
    Field,
    Sequence,
    Struct,
)
from ..errors import DeclaredError

NAME = "Conformance::Everything"


class Colour(IntEnum):
    """An enumeration with a value of its own."""

    red = 0
    green = 1
    ultraviolet = -7

    __contract__: ClassVar[Enumeration]


Colour.__contract__ = Enumeration("Conformance::Colour", (("red", 0), ("green", 1), ("ultraviolet", -7)), Colour)


@dataclass(slots=True)
class Nothing:
    """A struct without fields."""

    __contract__: ClassVar[Struct]


Nothing.__contract__ = Struct("Conformance::Nothing", (), Nothing)


@dataclass(slots=True)
class Point:
    """Fields of one kind."""

    x: float = 0.0
    y: float = 0.0

    __contract__: ClassVar[Struct]


Point.__contract__ = Struct("Conformance::Point", (Field("x", FLOAT64), Field("y", FLOAT64)), Point)


@dataclass(slots=True)
class Scalars:
    """Every primitive, in an order that needs padding."""

    flag: bool = False
    i8: int = 0
    u16: int = 0
    i64: int = 0
    u8: int = 0
    f32: float = 0.0
    i16: int = 0
    f64: float = 0.0
    text: str = ""
    u32: int = 0
    stamp: int = 0
    u64: int = 0
    i32: int = 0
    colour: Colour = Colour.red

    __contract__: ClassVar[Struct]


_KINDS = (BOOL, INT8, UINT16, INT64, UINT8, FLOAT32, INT16, FLOAT64, STRING, UINT32, TIME, UINT64, INT32)
_NAMES = ("flag", "i8", "u16", "i64", "u8", "f32", "i16", "f64", "text", "u32", "stamp", "u64", "i32")
Scalars.__contract__ = Struct(
    "Conformance::Scalars",
    (*map(Field, _NAMES, _KINDS), Field("colour", Colour.__contract__)),
    Scalars,
)


@dataclass(slots=True)
class Nested:
    """Structs, sequences and dictionaries in each other."""

    scalars: Scalars = field(default_factory=Scalars)
    points: list[Point] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    colours: list[Colour] = field(default_factory=list)
    by_name: dict[str, Point] = field(default_factory=dict)
    by_number: dict[int, str] = field(default_factory=dict)
    by_colour: dict[Colour, float] = field(default_factory=dict)
    rows: list[list[Point]] = field(default_factory=list)
    nothing: Nothing = field(default_factory=Nothing)

    __contract__: ClassVar[Struct]


Nested.__contract__ = Struct(
    "Conformance::Nested",
    (
        Field("scalars", Scalars.__contract__),
        Field("points", Sequence(Point.__contract__)),
        Field("names", Sequence(STRING)),
        Field("colours", Sequence(Colour.__contract__)),
        Field("by_name", Dictionary(STRING, Point.__contract__)),
        Field("by_number", Dictionary(INT32, STRING)),
        Field("by_colour", Dictionary(Colour.__contract__, FLOAT64)),
        Field("rows", Sequence(Sequence(Point.__contract__))),
        Field("nothing", Nothing.__contract__),
    ),
    Nested,
)


@dataclass(slots=True)
class Arrays:
    """An array of every kind."""

    octets: NDArray[np.uint8] = field(default_factory=lambda: np.empty(0, np.uint8))
    small: NDArray[np.int16] = field(default_factory=lambda: np.empty(0, np.int16))
    ints: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    floats: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))
    doubles: NDArray[np.float64] = field(default_factory=lambda: np.empty(0, np.float64))
    flags: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, np.bool_))

    __contract__: ClassVar[Struct]


Arrays.__contract__ = Struct(
    "Conformance::Arrays",
    (
        Field("octets", Sequence(UINT8)),
        Field("small", Sequence(INT16)),
        Field("ints", Sequence(INT64)),
        Field("floats", Sequence(FLOAT32)),
        Field("doubles", Sequence(FLOAT64)),
        Field("flags", Sequence(BOOL)),
    ),
    Arrays,
)


@dataclass(eq=False)
class Failed(DeclaredError):
    """A declared exception."""

    what: str = ""
    code: int = 0

    __contract__: ClassVar[ExceptionType]


Failed.__contract__ = ExceptionType("Conformance::Failed", (Field("what", STRING), Field("code", INT32)), python=Failed)


@dataclass(eq=False)
class FailedBadly(Failed):
    """One derived from it."""

    where: Point = field(default_factory=Point)

    __contract__: ClassVar[ExceptionType]


FailedBadly.__contract__ = ExceptionType(
    "Conformance::FailedBadly", (Field("where", Point.__contract__),), Failed.__contract__, FailedBadly
)


def _echo(name: str, kind: Struct) -> Operation[Any]:
    return Operation(NAME, name, (Field("value", kind),), (Field("ret", kind),))


echo_nested = _echo("echo_nested", Nested.__contract__)
echo_arrays = _echo("echo_arrays", Arrays.__contract__)
divide: Operation[tuple[int, int]] = Operation(
    NAME,
    "divide",
    (Field("dividend", INT64), Field("divisor", INT64)),
    (Field("ret", INT64), Field("remainder", INT64)),
    (Failed.__contract__,),
    Pattern.QUERY,
    idempotent=True,
)
work: Operation[str] = Operation(NAME, "work", (Field("task", STRING),), (Field("ret", STRING),), (), Pattern.QUERY)
poke: Operation[None] = Operation(NAME, "poke", (Field("number", INT32),), (), (), Pattern.COMMAND)
news: Operation[None] = Operation(
    NAME, "news", (Field("number", INT32), Field("text", STRING)), (), (), Pattern.PUBLISH
)

EVERYTHING = Interface(NAME, (echo_nested, echo_arrays, divide, work, poke, news))
