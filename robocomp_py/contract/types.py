"""The closed set of types that can travel, each with its width.

A type is a value: equal definitions are equal types. `Struct`, `Enumeration` and `ExceptionType`
may carry the Python class that stands for them in one generated module; a struct without one is
a message, whose Python form is the tuple of its fields.

numpy is imported only for what has its types: tools that read models do without it.
"""

from __future__ import annotations

import keyword
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache, cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    import numpy as np

MAX_DEPTH = 32
"""Types nested deeper than this are refused by the languages and by every codec."""


class Primitive(StrEnum):
    """The basic types, each with all that is the same on every wire and in every language.

    `python` is the class of its values. `letter` is how `struct` packs it, empty if its size varies. Sequences of
    those with `in_arrays` are numpy arrays. `TIME` is an instant: int nanoseconds since the Unix epoch.
    """

    python: type[Any]
    letter: str
    in_arrays: bool

    def __new__(cls, name: str, python: type[Any], letter: str, in_arrays: bool = True) -> Self:
        made = str.__new__(cls, name)
        made._value_ = name
        made.python, made.letter, made.in_arrays = python, letter, in_arrays
        return made

    BOOL = "bool", bool, "?"
    INT8 = "int8", int, "b"
    UINT8 = "uint8", int, "B"
    INT16 = "int16", int, "h"
    UINT16 = "uint16", int, "H"
    INT32 = "int32", int, "i"
    UINT32 = "uint32", int, "I"
    INT64 = "int64", int, "q"
    UINT64 = "uint64", int, "Q"
    FLOAT32 = "float32", float, "f"
    FLOAT64 = "float64", float, "d"
    STRING = "string", str, "", False
    TIME = "time", int, "q", False

    @property
    def zero(self) -> Any:
        """The value of a field that is not set."""
        return self.python()


BOOL, STRING, TIME = Primitive.BOOL, Primitive.STRING, Primitive.TIME
INT8, INT16, INT32, INT64 = Primitive.INT8, Primitive.INT16, Primitive.INT32, Primitive.INT64
UINT8, UINT16, UINT32, UINT64 = Primitive.UINT8, Primitive.UINT16, Primitive.UINT32, Primitive.UINT64
FLOAT32, FLOAT64 = Primitive.FLOAT32, Primitive.FLOAT64

INTEGERS = frozenset(kind for kind in Primitive if kind.python is int and kind.in_arrays)
FLOATS = frozenset(kind for kind in Primitive if kind.python is float)
FLOAT32_MAX = (2 - 2**-23) * 2.0**127
FLOAT32_LIMIT = 2.0**128 - 2.0**103
"""Smaller values are rounded to a float32, at most to FLOAT32_MAX; others would become infinite."""


@cache
def dtypes() -> dict[Primitive, np.dtype[Any]]:
    """The little-endian numpy dtype of each primitive whose sequences are arrays. On a little-endian host, it is the
    same object as in numpy's own arrays, so most arrays that fit are found by `is`."""
    import numpy as np

    return {kind: np.dtype(np.dtype(kind.letter).newbyteorder("<").str) for kind in Primitive if kind.in_arrays}


def integer_range(kind: Primitive) -> tuple[int, int]:
    """Smallest and largest value of an integer type; of TIME, what ROS 2 can carry: int32 seconds around 1970."""
    if kind is TIME:
        return -(2**31) * 10**9, 2**31 * 10**9 - 1
    bits = 8 * struct.calcsize(f"<{kind.letter}")
    return (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if kind.letter.islower() else (0, 2**bits - 1)


@dataclass(frozen=True)
class Field:
    """A named member of a struct, or a parameter of an operation."""

    name: str
    type: Type
    default: Any = None
    """What a new value holds, if not zero."""
    doc: str = field(default="", compare=False, repr=False)

    @cached_property
    def attribute(self) -> str:
        """Its name in Python: `lambda` is spelt `lambda_` there."""
        return python_name(self.name)


@dataclass(frozen=True)
class Struct:
    """Fields in a fixed order. `name` is qualified: `RoboCompLaser::TData`."""

    name: str
    fields: tuple[Field, ...]
    python: type[Any] | None = field(default=None, repr=False)
    doc: str = field(default="", compare=False, repr=False)
    called: str = field(default="", compare=False, repr=False)
    """What people call it, if not by its name: for the messages of an operation, the operation."""

    @property
    def title(self) -> str:
        """What errors call it."""
        return self.called or self.name

    @cached_property
    def is_flat(self) -> bool:
        """Whether it has fields, and all of them are numbers, bools or enumerators."""
        return bool(self.fields) and all(_element(each.type) for each in self.fields)

    @cached_property
    def dtype(self) -> np.dtype[np.void] | None:
        """The packed little-endian numpy dtype of its records, with the names of its attributes; None if not flat.

        Enumerators are int32.
        """
        if not self.is_flat:
            return None
        import numpy as np

        return np.dtype([(each.attribute, dtypes()[kind]) for each in self.fields if (kind := _element(each.type))])


@dataclass(frozen=True)
class Response(Struct):
    """The results of an operation as a message: the returned value first, named `ret`, then the `out` parameters."""


@dataclass(frozen=True)
class Enumeration:
    """Named integers, carried as int32."""

    name: str
    members: tuple[tuple[str, int], ...]
    python: type[Any] | None = field(default=None, repr=False)
    doc: str = field(default="", compare=False, repr=False)


@dataclass(frozen=True)
class Sequence:
    """Any number of items; of numbers and bools, a numpy array of one dimension.

    `name` is what the IDSL calls it, `RoboCompLaser::TLaserData`; it means nothing to the wire.
    With `records`, a sequence of a flat struct is a numpy array of records, too.
    """

    item: Type
    name: str = field(default="", compare=False, repr=False)
    records: bool = False

    def __post_init__(self) -> None:
        if self.records and not self.is_array:
            raise ValueError(f"{spell(self.item)} is not a flat struct, so it has no records")

    @property
    def is_array(self) -> bool:
        """False where the sequence is a Python list."""
        if self.records:
            return isinstance(self.item, Struct) and self.item.is_flat
        return isinstance(self.item, Primitive) and self.item.in_arrays

    @property
    def dtype(self) -> np.dtype[Any] | None:
        """The array's dtype, or None where the sequence is a Python list."""
        if self.records:
            return self.item.dtype if isinstance(self.item, Struct) else None
        return dtypes()[self.item] if isinstance(self.item, Primitive) and self.item.in_arrays else None


@dataclass(frozen=True)
class Dictionary:
    """Values by key; keys are strings, bools, integers or enumerators."""

    key: Type
    value: Type
    name: str = field(default="", compare=False, repr=False)


Type = Primitive | Struct | Enumeration | Sequence | Dictionary


@dataclass(frozen=True)
class ExceptionType:
    """An exception an operation may throw. `fields` are its own; those of its base come first on the wire."""

    name: str
    fields: tuple[Field, ...]
    base: ExceptionType | None = None
    python: type[Any] | None = field(default=None, repr=False)
    doc: str = field(default="", compare=False, repr=False)

    @cached_property
    def all_fields(self) -> tuple[Field, ...]:
        return (*(self.base.all_fields if self.base else ()), *self.fields)

    @cached_property
    def lineage(self) -> tuple[str, ...]:
        """Its name, then its bases' names, nearest first."""
        return (self.name, *(self.base.lineage if self.base else ()))


@dataclass(frozen=True)
class Thrown(Struct):
    """The message of an exception: its lineage as one text, then all its fields. See `thrown`."""

    kind: ExceptionType | None = None


LINEAGE = "<"
"""Between the names of a lineage."""


@lru_cache(maxsize=1024)
def thrown(kind: ExceptionType | None = None) -> Thrown:
    """The message of an exception of this kind; without one, the part that all of them begin with."""
    lineage = Field("exception", STRING)
    return Thrown(kind.name, (lineage, *kind.all_fields), kind=kind) if kind else Thrown("Thrown", (lineage,))


KEY_TYPES = INTEGERS | {BOOL, STRING}


def is_key(kind: Type) -> bool:
    """Whether a dictionary may be keyed by this type."""
    return isinstance(kind, Enumeration) or kind in KEY_TYPES


def _element(kind: Type) -> Primitive | None:
    """What a number, bool or enumerator is in an array; None for other types."""
    if isinstance(kind, Enumeration):
        return INT32
    return kind if isinstance(kind, Primitive) and kind.in_arrays else None


def python_name(name: str) -> str:
    """How an IDSL name is spelt in Python: keywords get an underscore behind."""
    return f"{name}_" if keyword.iskeyword(name) or name == "self" else name


def children(kind: Type) -> tuple[Type, ...]:
    """The types directly inside a type."""
    match kind:
        case Struct(fields=fields):
            return tuple(f.type for f in fields)
        case Sequence(item):
            return (item,)
        case Dictionary(key, value):
            return (key, value)
        case Primitive() | Enumeration():
            return ()


def arrays(fields: Iterable[Field]) -> Iterator[tuple[tuple[Field, ...], Primitive]]:
    """The arrays among these fields and in structs below them: the fields that lead to each, and what it holds."""
    for each in fields:
        match each.type:
            case Struct(fields=inner):
                yield from (((each, *path), item) for path, item in arrays(inner))
            case Sequence(Primitive() as item) if item.in_arrays:
                yield (each,), item
            case Primitive() | Enumeration() | Sequence() | Dictionary():
                continue


def walk(*kinds: Type) -> Iterator[Struct | Enumeration]:
    """The named types in and under these, each once, those used before those that use them."""
    seen: set[str] = set()

    def visit(kind: Type) -> Iterator[Struct | Enumeration]:
        if isinstance(kind, Struct | Enumeration):
            if kind.name in seen:
                return
            seen.add(kind.name)
        for child in children(kind):
            yield from visit(child)
        if isinstance(kind, Struct | Enumeration):
            yield kind

    for kind in kinds:
        yield from visit(kind)


def spell(kind: Type) -> str:
    """A type as canonical text, by the name of its structs and enumerations."""
    match kind:
        case Primitive():
            return kind.value
        case Struct(name=name) | Enumeration(name=name):
            return name
        case Sequence(item, records=True):
            return f"records<{spell(item)}>"
        case Sequence(item):
            return f"sequence<{spell(item)}>"
        case Dictionary(key, value):
            return f"dictionary<{spell(key)},{spell(value)}>"
