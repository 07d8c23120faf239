# Generated from Names.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: PYI042, RUF009, UP040, RUF100
"""Module class: types, interfaces and proxies."""

from __future__ import annotations

import builtins
import typing
from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import (
    BOOL,
    FLOAT32,
    INT32,
    STRING,
    DeclaredError,
    Dictionary,
    Enumeration,
    ExceptionType,
    Field,
    Interface,
    Operation,
    Pattern,
    Sequence,
    Struct,
)

from . import lambda_

pi = 1

MAX = 2


class Mode(IntEnum):
    """Mode of module class."""

    None_ = 0
    True_ = 1
    name_ = 2
    name__ = 3
    mro_ = 4
    value_ = 5
    real_ = 6
    bit_length_ = 7
    from_bytes_ = 8
    _order__ = 9
    self = 10
    Enumeration_ = 11

    __contract__: ClassVar[Enumeration]


Mode.__contract__ = Enumeration(
    "class::Mode",
    (
        ("None", 0),
        ("True", 1),
        ("name", 2),
        ("name_", 3),
        ("mro", 4),
        ("value", 5),
        ("real", 6),
        ("bit_length", 7),
        ("from_bytes", 8),
        ("_order_", 9),
        ("self", 10),
        ("Enumeration", 11),
    ),
    Mode,
)


@dataclass(slots=True)
class Field_:
    """Field of module class."""

    lambda_: int = 0
    from_: int = 0
    self_: int = 0
    deadline: int = 0
    contract: int = 0
    field: int = 0
    python: int = 0

    __contract__: ClassVar[Struct]


Field_.__contract__ = Struct(
    "class::Field",
    (
        Field("lambda", INT32),
        Field("from", INT32),
        Field("self", INT32),
        Field("deadline", INT32),
        Field("contract", INT32),
        Field("field", INT32),
        Field("python", INT32),
    ),
    Field_,
)


@dataclass(slots=True)
class Point:
    """Point of module class."""

    x: float = 0.0
    y: float = 0.0

    __contract__: ClassVar[Struct]


Point.__contract__ = Struct(
    "class::Point",
    (
        Field("x", FLOAT32),
        Field("y", FLOAT32),
    ),
    Point,
)

dict_: TypeAlias = dict[str, Point]

_Mode = Mode  # a field has this name, too
_Point = Point  # a field has this name, too
_np = np  # a field has this name, too


@dataclass(slots=True)
class list2:
    """list2 of module class."""

    Point: _Point = field(default_factory=_Point)
    other: _Point = field(default_factory=_Point)
    np: int = 0
    values: NDArray[_np.float32] = field(
        default_factory=lambda: _np.empty(0, _np.float32),
    )
    Mode: _Mode = _Mode.None_
    second: _Mode = _Mode.value_
    T: lambda_.T = field(default_factory=lambda_.T)
    third: lambda_.T = field(default_factory=lambda_.T)

    __contract__: ClassVar[Struct]


list2.__contract__ = Struct(
    "class::list2",
    (
        Field("Point", Point.__contract__),
        Field("other", Point.__contract__),
        Field("np", INT32),
        Field("values", Sequence(FLOAT32)),
        Field("Mode", Mode.__contract__),
        Field("second", Mode.__contract__, "value"),
        Field("T", lambda_.T.__contract__),
        Field("third", lambda_.T.__contract__),
    ),
    list2,
)

_field = field  # a field has this name, too


@dataclass(slots=True)
class list_:
    """list of module class."""

    field: NDArray[np.int32] = _field(default_factory=lambda: np.empty(0, np.int32))
    list: builtins.list[str] = _field(default_factory=builtins.list)
    dict: dict_ = _field(default_factory=dict)
    others: builtins.list[list2] = _field(default_factory=builtins.list)
    int: float = 0.0
    float: builtins.int = 0
    bool: bool = False

    __contract__: ClassVar[Struct]


list_.__contract__ = Struct(
    "class::list",
    (
        Field("field", Sequence(INT32)),
        Field("list", Sequence(STRING)),
        Field("dict", Dictionary(STRING, Point.__contract__, "class::dict")),
        Field("others", Sequence(list2.__contract__)),
        Field("int", FLOAT32),
        Field("float", INT32),
        Field("bool", BOOL),
    ),
    list_,
)


@dataclass(slots=True)
class Sequence_:
    """Sequence of module class."""

    dataclass: int = 0
    ClassVar: str = ""

    __contract__: typing.ClassVar[Struct]


Sequence_.__contract__ = Struct(
    "class::Sequence",
    (
        Field("dataclass", INT32),
        Field("ClassVar", STRING),
    ),
    Sequence_,
)

_Struct = Struct  # a field has this name, too


@dataclass(slots=True)
class Struct_:
    """Struct of module class."""

    Struct: int = 0
    ClassVar: int = 0

    __contract__: typing.ClassVar[_Struct]


Struct_.__contract__ = Struct(
    "class::Struct",
    (
        Field("Struct", INT32),
        Field("ClassVar", INT32),
    ),
    Struct_,
)


@dataclass(slots=True)
class I:  # noqa: E742, RUF100
    """I of module class."""

    l: float = 0.0  # noqa: E741, RUF100
    O: float = 0.0  # noqa: E741, RUF100
    I: str = "a text that is so long that no line is wide enough for it, not even one of its own"  # noqa: E501, E741, RUF100

    __contract__: ClassVar[Struct]


I.__contract__ = Struct(
    "class::I",
    (
        Field("l", FLOAT32),
        Field("O", FLOAT32),
        Field(
            "I",
            STRING,
            "a text that is so long that no line is wide enough for it, not even one of its own",  # noqa: E501, RUF100
        ),
    ),
    I,
)


class O(IntEnum):  # noqa: E742, RUF100
    """O of module class."""

    I = 0  # noqa: E741, RUF100
    O = 1  # noqa: E741, RUF100
    l = 2  # noqa: E741, RUF100

    __contract__: ClassVar[Enumeration]


O.__contract__ = Enumeration(
    "class::O",
    (
        ("I", 0),
        ("O", 1),
        ("l", 2),
    ),
    O,
)


@dataclass(slots=True)
class IntEnum_:
    """IntEnum of module class."""

    __contract__: ClassVar[Struct]


IntEnum_.__contract__ = Struct(
    "class::IntEnum",
    (),
    IntEnum_,
)


@dataclass(slots=True)
class dataclass_:
    """dataclass of module class."""

    __contract__: ClassVar[Struct]


dataclass_.__contract__ = Struct(
    "class::dataclass",
    (),
    dataclass_,
)


@dataclass(slots=True)
class np_:
    """np of module class."""

    __contract__: ClassVar[Struct]


np_.__contract__ = Struct(
    "class::np",
    (),
    np_,
)


@dataclass(slots=True)
class object:
    """object of module class."""

    __contract__: ClassVar[Struct]


object.__contract__ = Struct(
    "class::object",
    (),
    object,
)


@dataclass(slots=True)
class int__:
    """int_ of module class."""

    __contract__: ClassVar[Struct]


int__.__contract__ = Struct(
    "class::int_",
    (),
    int__,
)


@dataclass(eq=False)
class ValueError(DeclaredError):
    """ValueError of module class."""

    message: str = ""
    str: str = ""

    __contract__: ClassVar[ExceptionType]


ValueError.__contract__ = ExceptionType(
    "class::ValueError",
    (
        Field("message", STRING),
        Field("str", STRING),
    ),
    base=None,
    python=ValueError,
)


@dataclass(eq=False)
class Exception(ValueError):
    """Exception of module class."""

    Point: _Point = field(default_factory=_Point)
    other: _Point = field(default_factory=_Point)

    __contract__: ClassVar[ExceptionType]


Exception.__contract__ = ExceptionType(
    "class::Exception",
    (
        Field("Point", Point.__contract__),
        Field("other", Point.__contract__),
    ),
    base=ValueError.__contract__,
    python=Exception,
)

_Odd_import: Operation[None] = Operation(
    "class::Odd",
    "import",
    inputs=(
        Field("deadline", INT32),
        Field("deadline_", INT32),
        Field("self", INT32),
        Field("class", list_.__contract__),
    ),
)
_Odd_list: Operation[tuple[list_, Mode, dict_]] = Operation(
    "class::Odd",
    "list",
    inputs=(Field("list", Sequence(FLOAT32)),),
    outputs=(
        Field("ret", list_.__contract__),
        Field("int", Mode.__contract__),
        Field("dict", Dictionary(STRING, Point.__contract__, "class::dict")),
    ),
)
_Odd_Point: Operation[tuple[Point, Point]] = Operation(
    "class::Odd",
    "Point",
    inputs=(Field("Point", Point.__contract__),),
    outputs=(
        Field("ret", Point.__contract__),
        Field("second", Point.__contract__),
    ),
    raises=(
        ValueError.__contract__,
        Exception.__contract__,
    ),
)
_Odd_interface: Operation[int] = Operation(
    "class::Odd",
    "interface",
    outputs=(Field("ret", INT32),),
)
_Odd__ask: Operation[int] = Operation(
    "class::Odd",
    "_ask",
    inputs=(
        Field("x", INT32),
        Field("float", FLOAT32),
    ),
    outputs=(Field("ret", INT32),),
)
_Odd__send: Operation[None] = Operation(
    "class::Odd",
    "_send",
)
_Odd_getX: Operation[None] = Operation(
    "class::Odd",
    "getX",
)
_Odd_getXAsync: Operation[int] = Operation(
    "class::Odd",
    "getXAsync",
    outputs=(Field("ret", INT32),),
)
_Odd_str: Operation[str] = Operation(
    "class::Odd",
    "str",
    outputs=(Field("ret", STRING),),
)
_Odd_strs: Operation[list[str]] = Operation(
    "class::Odd",
    "strs",
    inputs=(Field("str", Sequence(STRING)),),
    outputs=(Field("ret", Sequence(STRING)),),
)
_Odd_float: Operation[float] = Operation(
    "class::Odd",
    "float",
    inputs=(
        Field("float", FLOAT32),
        Field("mode", Mode.__contract__, "name"),
    ),
    outputs=(Field("ret", FLOAT32),),
)
_Odd_tuple: Operation[str] = Operation(
    "class::Odd",
    "tuple",
    outputs=(Field("ret", STRING),),
)
_Odd_Future: Operation[Sequence_] = Operation(
    "class::Odd",
    "Future",
    inputs=(Field("from", lambda_.T.__contract__),),
    outputs=(Field("ret", Sequence_.__contract__),),
)
_Odd_class: Operation[lambda_.T] = Operation(
    "class::Odd",
    "class",
    outputs=(Field("ret", lambda_.T.__contract__),),
)
_Odd_l: Operation[I] = Operation(
    "class::Odd",
    "l",
    inputs=(
        Field("l", I.__contract__),
        Field("O", O.__contract__),
        Field("I", Sequence(FLOAT32)),
    ),
    outputs=(Field("ret", I.__contract__),),
)
_Odd_command: Operation[None] = Operation(
    "class::Odd",
    "command",
    inputs=(Field("s", Struct_.__contract__),),
    pattern=Pattern.COMMAND,
)
_Odd_publish: Operation[None] = Operation(
    "class::Odd",
    "publish",
    inputs=(Field("f", Field_.__contract__),),
    pattern=Pattern.PUBLISH,
)
ODD_INTERFACE = Interface(
    "class::Odd",
    (
        _Odd_import,
        _Odd_list,
        _Odd_Point,
        _Odd_interface,
        _Odd__ask,
        _Odd__send,
        _Odd_getX,
        _Odd_getXAsync,
        _Odd_str,
        _Odd_strs,
        _Odd_float,
        _Odd_tuple,
        _Odd_Future,
        _Odd_class,
        _Odd_l,
        _Odd_command,
        _Odd_publish,
    ),
)

EMPTY_INTERFACE = Interface(
    "class::Empty",
    (),
)
