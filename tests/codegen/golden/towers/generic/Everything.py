# Generated from Everything.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module Everything: types, interfaces and proxies."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from robocomp_py.runtime.api import (
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
    DeclaredError,
    Dictionary,
    Enumeration,
    ExceptionType,
    Field,
    Interface,
    Operation,
    Pattern,
    Proxy,
    Sequence,
    Struct,
)

from . import Shapes

limit = 10  # how many there may be

half = 0.5

greeting = "say \\ hello"


class Level(IntEnum):
    """How much of something."""

    low = -1
    medium = 5
    high = 6

    __contract__: ClassVar[Enumeration]


Level.__contract__ = Enumeration(
    "Everything::Level",
    (
        ("low", -1),
        ("medium", 5),
        ("high", 6),
    ),
    Level,
)

usual = Level.medium

epoch = 0


@dataclass(slots=True)
class Widths:
    """All types whose width their name tells."""

    yes: bool = True
    a: int = 0
    b: int = 0
    c: int = 0
    d: int = 0
    e: int = 0
    f: int = 0
    g: int = 0
    h: int = 255
    i: float = 1.5
    j: float = 0.001
    k: int = 0

    __contract__: ClassVar[Struct]


Widths.__contract__ = Struct(
    "Everything::Widths",
    (
        Field("yes", BOOL, True),
        Field("a", INT8),
        Field("b", UINT8),
        Field("c", INT16),
        Field("d", UINT16),
        Field("e", INT32),
        Field("f", UINT32),
        Field("g", INT64),
        Field("h", UINT64, 255),
        Field("i", FLOAT32, 1.5),
        Field("j", FLOAT64, 0.001),
        Field("k", TIME),
    ),
    Widths,
    doc="All types whose width their name tells.",
)


@dataclass(slots=True)
class Slice:
    """All types with the names of Slice."""

    a: int = 0  # 8 bits
    b: int = 0  # 16 bits
    # 32 bits, and a comment that is so long that it cannot stand behind its field in
    # one line
    c: int = -7
    d: int = 0  # 64 bits
    e: float = 0.0
    f: float = 0.0
    g: str = "unnamed"
    h: Level = Level.high
    i: Shapes.Point = field(default_factory=Shapes.Point)  # of another module

    __contract__: ClassVar[Struct]


Slice.__contract__ = Struct(
    "Everything::Slice",
    (
        Field("a", UINT8, doc="8 bits"),
        Field("b", INT16, doc="16 bits"),
        Field(
            "c",
            INT32,
            -7,
            doc="32 bits, and a comment that is so long that it cannot stand behind its field in one line",  # noqa: E501, RUF100
        ),
        Field("d", INT64, doc="64 bits"),
        Field("e", FLOAT32),
        Field("f", FLOAT64),
        Field("g", STRING, "unnamed"),
        Field("h", Level.__contract__, "high"),
        Field("i", Shapes.Point.__contract__, doc="of another module"),
    ),
    Slice,
    doc="All types with the names of Slice.",
)


@dataclass(slots=True)
class Nothing:
    """Nothing of module Everything."""

    __contract__: ClassVar[Struct]


Nothing.__contract__ = Struct(
    "Everything::Nothing",
    (),
    Nothing,
)

Numbers: TypeAlias = NDArray[np.float32]

Slices: TypeAlias = list[Slice]

Cube: TypeAlias = list[list[Numbers]]

Levels: TypeAlias = list[Level]

ByName: TypeAlias = dict[str, Widths]

ByLevel: TypeAlias = dict[Level, Numbers]

Nothings: TypeAlias = dict[int, Nothing]


@dataclass(slots=True)
class Containers:
    """All of them in one."""

    numbers: Numbers = field(default_factory=lambda: np.empty(0, np.float32))
    slices: Slices = field(default_factory=list)
    cube: Cube = field(default_factory=list)
    levels: Levels = field(default_factory=list)
    byName: ByName = field(default_factory=dict)
    byLevel: ByLevel = field(default_factory=dict)
    nothings: Nothings = field(default_factory=dict)
    flags: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, np.bool_))
    raw: NDArray[np.uint8] = field(default_factory=lambda: np.empty(0, np.uint8))
    words: list[str] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    outlines: list[Shapes.Points] = field(default_factory=list)

    __contract__: ClassVar[Struct]


Containers.__contract__ = Struct(
    "Everything::Containers",
    (
        Field("numbers", Sequence(FLOAT32)),
        Field("slices", Sequence(Slice.__contract__)),
        Field("cube", Sequence(Sequence(Sequence(FLOAT32)))),
        Field("levels", Sequence(Level.__contract__)),
        Field("byName", Dictionary(STRING, Widths.__contract__, "Everything::ByName")),
        Field(
            "byLevel",
            Dictionary(Level.__contract__, Sequence(FLOAT32), "Everything::ByLevel"),
        ),
        Field(
            "nothings",
            Dictionary(INT32, Nothing.__contract__, "Everything::Nothings"),
        ),
        Field("flags", Sequence(BOOL)),
        Field("raw", Sequence(UINT8)),
        Field("words", Sequence(STRING)),
        Field("times", Sequence(TIME)),
        Field("outlines", Sequence(Sequence(Shapes.Point.__contract__))),
    ),
    Containers,
    doc="All of them in one.",
)


@dataclass(eq=False)
class Failed(DeclaredError):
    """Something did not work."""

    why: str = ""
    code: int = 1

    __contract__: ClassVar[ExceptionType]


Failed.__contract__ = ExceptionType(
    "Everything::Failed",
    (
        Field("why", STRING),
        Field("code", INT32, 1),
    ),
    base=None,
    python=Failed,
    doc="Something did not work.",
)


@dataclass(eq=False)
class Late(Failed):
    """It did not work in time."""

    since: int = 0
    measured: Numbers = field(default_factory=lambda: np.empty(0, np.float32))

    __contract__: ClassVar[ExceptionType]


Late.__contract__ = ExceptionType(
    "Everything::Late",
    (
        Field("since", TIME),
        Field("measured", Sequence(FLOAT32)),
    ),
    base=Failed.__contract__,
    python=Late,
    doc="It did not work in time.",
)

_Counter_count: Operation[int] = Operation(
    "Everything::Counter",
    "count",
    outputs=(Field("ret", INT32),),
    idempotent=True,
)
COUNTER_INTERFACE = Interface(
    "Everything::Counter",
    (_Counter_count,),
)

_Store_count: Operation[int] = Operation(
    "Everything::Store",
    "count",
    outputs=(Field("ret", INT32),),
    idempotent=True,
)
_Store_keep: Operation[Containers] = Operation(
    "Everything::Store",
    "keep",
    inputs=(Field("what", Containers.__contract__),),
    outputs=(Field("ret", Containers.__contract__),),
    doc="Keep something, and get it back.",
)
_Store_widths: Operation[Widths] = Operation(
    "Everything::Store",
    "widths",
    inputs=(Field("what", Widths.__contract__),),
    outputs=(Field("ret", Widths.__contract__),),
    idempotent=True,
)
_Store_slices: Operation[tuple[Slices, int, Shapes.Point]] = Operation(
    "Everything::Store",
    "slices",
    inputs=(Field("what", Sequence(Slice.__contract__)),),
    outputs=(
        Field("ret", Sequence(Slice.__contract__)),
        Field("number", INT32),
        Field("middle", Shapes.Point.__contract__),
    ),
)
_Store_check: Operation[None] = Operation(
    "Everything::Store",
    "check",
    inputs=(
        Field("fail", BOOL),
        Field("late", BOOL),
    ),
    raises=(
        Late.__contract__,
        Failed.__contract__,
    ),
    doc="Do nothing. Fails if it is told to.",
)
_Store_adjust: Operation[None] = Operation(
    "Everything::Store",
    "adjust",
    inputs=(
        Field("to", FLOAT32),
        Field("level", Level.__contract__, "medium"),
        Field("note", STRING, "none"),
        Field("share", FLOAT64, 1.0),
    ),
)
_Store_cube: Operation[Cube] = Operation(
    "Everything::Store",
    "cube",
    inputs=(Field("what", Sequence(Sequence(Sequence(FLOAT32)))),),
    outputs=(Field("ret", Sequence(Sequence(Sequence(FLOAT32)))),),
)
_Store_levels: Operation[ByLevel] = Operation(
    "Everything::Store",
    "levels",
    inputs=(
        Field(
            "what",
            Dictionary(Level.__contract__, Sequence(FLOAT32), "Everything::ByLevel"),
        ),
    ),
    outputs=(
        Field(
            "ret",
            Dictionary(Level.__contract__, Sequence(FLOAT32), "Everything::ByLevel"),
        ),
    ),
)
_Store_acknowledge: Operation[None] = Operation(
    "Everything::Store",
    "acknowledge",
    pattern=Pattern.QUERY,
)
_Store_nothings: Operation[list[Nothing]] = Operation(
    "Everything::Store",
    "nothings",
    inputs=(Field("number", INT32),),
    outputs=(Field("ret", Sequence(Nothing.__contract__)),),
    pattern=Pattern.QUERY,
)
_Store_trigger: Operation[None] = Operation(
    "Everything::Store",
    "trigger",
    inputs=(
        Field("number", INT32),
        Field("levels", Sequence(Level.__contract__)),
    ),
    pattern=Pattern.COMMAND,
)
_Store_announced: Operation[None] = Operation(
    "Everything::Store",
    "announced",
    inputs=(Field("what", STRING),),
    pattern=Pattern.PUBLISH,
)
STORE_INTERFACE = Interface(
    "Everything::Store",
    (
        _Store_count,
        _Store_keep,
        _Store_widths,
        _Store_slices,
        _Store_check,
        _Store_adjust,
        _Store_cube,
        _Store_levels,
        _Store_acknowledge,
        _Store_nothings,
        _Store_trigger,
        _Store_announced,
    ),
)

_News_told: Operation[None] = Operation(
    "Everything::News",
    "told",
    inputs=(
        Field("what", STRING),
        Field("values", Sequence(FLOAT32)),
    ),
)
_News_level: Operation[None] = Operation(
    "Everything::News",
    "level",
    inputs=(Field("now", Level.__contract__),),
    pattern=Pattern.PUBLISH,
)
_News_kept: Operation[None] = Operation(
    "Everything::News",
    "kept",
    inputs=(Field("what", Containers.__contract__),),
    pattern=Pattern.PUBLISH,
)
_News_compared: Operation[None] = Operation(
    "Everything::News",
    "compared",
    inputs=(
        Field("left", Containers.__contract__),
        Field("right", Containers.__contract__),
        Field("numbers", Sequence(FLOAT32)),
    ),
    pattern=Pattern.PUBLISH,
)
_News_asked: Operation[int] = Operation(
    "Everything::News",
    "asked",
    outputs=(Field("ret", INT32),),
    doc="cannot be published",
)
NEWS_INTERFACE = Interface(
    "Everything::News",
    (
        _News_told,
        _News_level,
        _News_kept,
        _News_compared,
        _News_asked,
    ),
)


@dataclass(slots=True)
class NewsToldRequest:
    """The message of `told`, to be filled."""

    what: str = ""
    values: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))


@dataclass(slots=True)
class NewsComparedRequest:
    """The message of `compared`, to be filled."""

    left: Containers = field(default_factory=Containers)
    right: Containers = field(default_factory=Containers)
    numbers: Numbers = field(default_factory=lambda: np.empty(0, np.float32))


class NewsPublisher(Proxy):
    """Publishes News. A call waits only if its QoS is reliable."""

    interface = NEWS_INTERFACE

    def told(
        self,
        what: str,
        values: ArrayLike,
        *,
        deadline: float | None = None,
    ) -> None:
        """`told` of Everything.News.

        IDSL: void told(string what, sequence<float> values)
        """
        self._send(_News_told, (what, values), deadline)

    def loanTold(
        self,
        values: int | tuple[int, ...],
        *,
        deadline: float | None = None,
    ) -> AbstractContextManager[NewsToldRequest]:
        """`told` with an array of this shape, to be filled in the memory that is sent.

        The message is sent at the end of the `with` block, unless it raises. The array
        must be filled completely, and must not be used after the block.
        """
        return self._loan(_News_told, NewsToldRequest, (values,), deadline)

    def level(self, now: Level, *, deadline: float | None = None) -> None:
        """`level` of Everything.News.

        IDSL: [publish] void level(Level now)
        """
        self._send(_News_level, (now,), deadline)

    def kept(self, what: Containers, *, deadline: float | None = None) -> None:
        """`kept` of Everything.News.

        IDSL: [publish] void kept(Containers what)
        """
        self._send(_News_kept, (what,), deadline)

    def loanKept(
        self,
        *,
        numbers: int | tuple[int, ...] = 0,
        flags: int | tuple[int, ...] = 0,
        raw: int | tuple[int, ...] = 0,
        deadline: float | None = None,
    ) -> AbstractContextManager[Containers]:
        """`kept` with arrays of these shapes, to be filled in the memory that is sent.

        The message is sent at the end of the `with` block, unless it raises. The arrays
        must be filled completely, and must not be used after the block.
        """
        return self._loan(_News_kept, Containers, (numbers, flags, raw), deadline)

    def compared(
        self,
        left: Containers,
        right: Containers,
        numbers: ArrayLike,
        *,
        deadline: float | None = None,
    ) -> None:
        """`compared` of Everything.News.

        IDSL: [publish] void compared(Containers left, Containers right, Numbers
        numbers)
        """
        self._send(_News_compared, (left, right, numbers), deadline)

    def loanCompared(
        self,
        *,
        left_numbers: int | tuple[int, ...] = 0,
        left_flags: int | tuple[int, ...] = 0,
        left_raw: int | tuple[int, ...] = 0,
        right_numbers: int | tuple[int, ...] = 0,
        right_flags: int | tuple[int, ...] = 0,
        right_raw: int | tuple[int, ...] = 0,
        numbers: int | tuple[int, ...] = 0,
        deadline: float | None = None,
    ) -> AbstractContextManager[NewsComparedRequest]:
        """`compared` with arrays of these shapes, to be filled in the memory that is
        sent.

        The message is sent at the end of the `with` block, unless it raises. The arrays
        must be filled completely, and must not be used after the block.
        """
        return self._loan(
            _News_compared,
            NewsComparedRequest,
            (
                left_numbers,
                left_flags,
                left_raw,
                right_numbers,
                right_flags,
                right_raw,
                numbers,
            ),
            deadline,
        )
