"""Slice's vocabulary: type names, keywords, and comments."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from ..contract.types import Primitive

WIDTH = 100

SPELLED = {
    Primitive.BOOL: "bool",
    Primitive.INT8: "byte",
    Primitive.UINT8: "byte",
    Primitive.INT16: "short",
    Primitive.UINT16: "int",
    Primitive.INT32: "int",
    Primitive.UINT32: "long",
    Primitive.INT64: "long",
    Primitive.UINT64: "long",
    Primitive.FLOAT32: "float",
    Primitive.FLOAT64: "double",
    Primitive.STRING: "string",
    Primitive.TIME: "long",
}
NOTED = {
    Primitive.INT8: "int8",
    Primitive.UINT16: "uint16",
    Primitive.UINT32: "uint32",
    Primitive.UINT64: "uint64",
    Primitive.TIME: "time: nanoseconds since 1970",
}
"""Comments for types whose meaning Slice does not show."""

KEYWORDS = frozenset(
    re.findall(
        r"\w+",
        """
    bool byte class const dictionary double enum exception extends false float idempotent implements int interface
    local LocalObject long module Object optional out sequence short string struct throws true Value void
    """,
    )
)
TYPES_OF_ITS_OWN = ("LocalObject", "Object", "Value")
"""Names that are reserved even when escaped."""


SUFFIXES = ("Prx", "Ptr", "Helper", "Holder")


def macro(stem: str) -> str:
    """The name of a file as an identifier of the preprocessor: `año` → `A_F1O`."""
    found = re.sub(r"[^A-Za-z0-9_]", lambda char: "_" if char[0].isascii() else f"_{ord(char[0]):X}", stem).upper()
    return f"_{found}" if found[:1].isdigit() else found


def escaped(name: str) -> str:
    return f"\\{name}" if name in KEYWORDS else name


def indented(lines: Iterable[str]) -> Iterator[str]:
    yield from (f"    {line}" for line in lines)
