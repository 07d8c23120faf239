"""Unusual values to send, made anew each time, because reading uses up some of them."""

from __future__ import annotations

import array
import datetime
import decimal
import enum
import fractions
import math
import types
from collections import OrderedDict, UserDict, deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np

from robocomp_py.testing.everything import Colour, Nothing, Point
from robocomp_py.wire.values import RANGES

FLOAT32_LIMIT = 2.0**128 - 2.0**103
"""The smallest number that would be rounded to infinity."""


class Text(str):
    """Has another way to be shown."""

    __slots__ = ()

    def __str__(self) -> str:
        return "shown"


class Mood(enum.StrEnum):
    good = "good"


class Place(str, enum.Enum):  # noqa: UP042 : this is the kind whose str() is not its value
    here = "here"


class Direction(enum.IntEnum):
    """Another enumeration, with a member that `Colour` has, and one that it has not."""

    one = 1
    lost = 77


class Weekday(enum.Enum):
    monday = 1


class Index:
    """What `operator.index` takes for an int."""

    def __index__(self) -> int:
        return 1


class Real:
    def __float__(self) -> float:
        return 1.5


class Hostile:
    """Raises whatever is done to it."""

    def __getattr__(self, name: str) -> Any:
        raise RuntimeError(name)

    def __repr__(self) -> str:
        raise RuntimeError("repr")

    def __len__(self) -> int:
        raise RuntimeError("len")

    def __iter__(self) -> Any:
        raise RuntimeError("iter")


class Unhashable(int):
    __hash__ = None


def _frozen(values: Any) -> np.ndarray[Any, Any]:
    made = np.array(values)
    made.flags.writeable = False
    return made


def _each(values: Iterable[Any]) -> list[Callable[[], Any]]:
    """Makers of values that can be looked at more than once."""
    return [partial(_same, value) for value in values]


def _same(value: Any) -> Any:
    return value


_NUMPY = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f2", "f4", "f8", "g")

NUMBERS = [
    *_each((0, 1, -1, 2, 2**64, -(2**64), 10**400)),
    *_each(number for bounds in RANGES.values() for bound in bounds for number in (bound - 1, bound, bound + 1)),
    *_each((0.0, -0.0, 1.0, 0.1, 5e-324, 1e39, 1e300, FLOAT32_LIMIT, -FLOAT32_LIMIT)),
    *_each((math.nextafter(FLOAT32_LIMIT, 0.0), math.nan, math.inf, -math.inf)),
    *_each((True, False, np.True_, np.False_)),
    *_each(np.dtype(kind).type(1) for kind in _NUMPY),
    *_each((np.uint64(2**64 - 1), np.int64(-(2**63)), np.float32(0.1), np.float64(1e300))),
    *_each((1 + 2j, np.complex128(1 + 2j), decimal.Decimal("1.5"), fractions.Fraction(1, 2))),
    *_each((Colour.green, Direction.one, Direction.lost, Weekday.monday)),
    *_each((Index(), Real(), Unhashable(1))),
    *_each((np.array(1), np.array(1.5), np.array([1]))),
    *_each((datetime.datetime(2026, 1, 1), np.datetime64(5, "s"))),
]

TEXTS = [
    *_each(("", "text", "é", "\N{ROBOT FACE}", "a\0b", "\ud800", "1", "x" * 1000)),
    *_each((b"", b"ab", b"\xff", bytearray(b"ab"), memoryview(b"ab"))),
    *_each((Text("text"), Text("é"), Mood.good, Place.here, np.str_("text"))),
]

LISTS: list[Callable[[], Any]] = [
    list,
    lambda: [0, 1],
    lambda: [1, 2, 300],
    lambda: [0.5, 1],
    lambda: [1e39],
    lambda: [True, False],
    lambda: [True, 2],
    lambda: [None],
    lambda: ["a", "é"],
    lambda: [Text("a"), Place.here],
    lambda: ["a", 1],
    lambda: [b"a"],
    lambda: [-1],
    lambda: [2**64],
    lambda: [2**63, 1],
    lambda: [2**63, -1],
    lambda: [[1, 2], [3, 4]],
    lambda: [[1], [2, 3]],
    lambda: [(1, 2), (3,)],
    lambda: [np.arange(3), [5]],
    lambda: [Colour.red, 1, np.int8(-7)],
    lambda: [Colour.red, 2],
    lambda: [Point(1.0, 2.0), Point(1, True)],
    lambda: [Point(1.0, "2")],
    lambda: [Point(), None],
    lambda: [Nothing()],
    lambda: (1, 2),
    lambda: (1.0, 2.0),
    lambda: ("a", "b"),
    lambda: range(3),
    lambda: deque([1, 2]),
    lambda: (each for each in (1, 2)),
    lambda: map(str, (1, 2)),
    lambda: {1, 2},
    lambda: frozenset("ab"),
    lambda: {1: 2}.values(),
    lambda: {1: 2}.keys(),
    lambda: array.array("d", [1.0, 2.0]),
    lambda: array.array("b", [1, -1]),
    lambda: memoryview(np.ones(2, np.float32)),
    lambda: memoryview(np.ones((2, 2))),
    lambda: np.arange(6).reshape(2, 3),
    lambda: np.arange(6, dtype=">i4"),
    lambda: np.arange(6.0)[::2],
    lambda: np.asfortranarray(np.arange(6, dtype=np.uint8).reshape(2, 3)),
    lambda: _frozen([1.0, 2.0]),
    lambda: np.zeros(0),
    lambda: np.zeros((0, 3), np.int8),
    lambda: np.array([True, False]),
    lambda: np.array([1, 200, 3], np.uint8),
    lambda: np.array([0.1, float("nan"), float("inf")], np.float16),
    lambda: np.array([1, 2], object),
    lambda: np.array(["a", "b"]),
    lambda: np.array([1 + 2j]),
    lambda: np.array([5], "datetime64[s]"),
    lambda: np.array([(1, 2)], [("x", "i4"), ("y", "i4")]),
]

MAPPINGS: list[Callable[[], Any]] = [
    dict,
    lambda: {"a": 1, "b": 2},
    lambda: {"a": "x"},
    lambda: {Text("é"): 1},
    lambda: {b"a": 1},
    lambda: {1: "x", 2: "y"},
    lambda: {1: 1.5},
    lambda: {128: "x"},
    lambda: {True: "x", False: "y"},
    lambda: {np.int8(1): "x"},
    lambda: {np.True_: "x"},
    lambda: {1.0: "x"},
    lambda: {None: "x"},
    lambda: {(1, 2): "x"},
    lambda: {Colour.red: 1.5, Colour.ultraviolet: 2},
    lambda: {Direction.one: 1.0},
    lambda: {Direction.lost: 1.0},
    lambda: types.MappingProxyType({"a": 1}),
    lambda: OrderedDict(b=1, a=2),
    lambda: UserDict({1: "x"}),
    lambda: [("a", 1)],
]

OBJECTS: list[Callable[[], Any]] = [
    lambda: None,
    object,
    Hostile,
    Nothing,
    lambda: Point(1.0, 2.0),
    lambda: Point(np.float32(0.1), 1),
    lambda: Point("1", 2.0),
    lambda: Point(1.0, None),
    lambda: types.SimpleNamespace(x=1.0, y=2.0),
    lambda: types.SimpleNamespace(x=1.0),
    lambda: Point,
    lambda: ...,
]

ODDITIES = [*NUMBERS, *TEXTS, *LISTS, *MAPPINGS, *OBJECTS]
