"""Which Python values fit a type, and as which values they arrive; the same for all codecs.

    bool          bool, numpy's bool
    integers      int and everything `operator.index` accepts (numpy's integers, enumerators, bool), in range
    floats        float and everything `struct` packs as one (int, numpy's numbers); a float32 is rounded, and
                  never becomes infinite
    string        str that encodes to UTF-8
    time          as int64, within ROS 2's range
    enumeration   an integer that is one of its members
    struct        any object with its attributes; one without a Python class: a tuple
    sequence      of numbers and bools: see `arrays.as_array`; with `records`, and of other flat structs: see
                  `Records.taken`; others: list, tuple, anything with a length and an order
    dictionary    any mapping

Compiled encoders test for the plainest type first and call these functions for other types. If one
raises an exception, `explain.explain` calls them again, field by field, to find the reason.
"""

from __future__ import annotations

import operator
import struct
from collections.abc import Mapping, Set
from typing import Any

from ..contract.types import Primitive, integer_range

RANGES = {kind: integer_range(kind) for kind in Primitive if kind.python is int}
"""Smallest and largest value of each type that is an int in Python."""

_SINGLE, _DOUBLE = struct.Struct("<f"), struct.Struct("<d")


def as_bool(value: Any) -> bool:
    if isinstance(value, bool):
        return value
    import numpy as np  # tools do without it where they can

    if not isinstance(value, np.bool_):
        raise TypeError(f"{type(value).__name__} is not a bool")
    return bool(value)


def as_int(value: Any, low: int, high: int) -> int:
    number = operator.index(value)
    if not low <= number <= high:
        raise OverflowError(f"{number} is not from {low} to {high}")
    return int(number)


def as_float(value: Any) -> float:
    number: float = _DOUBLE.unpack(_DOUBLE.pack(value))[0]
    return number


def as_float32(value: Any) -> float:
    number: float = _SINGLE.unpack(_SINGLE.pack(value))[0]
    return number


def as_str(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{type(value).__name__} is not a str")
    value.encode()
    return str.__str__(value)  # the text of a subclass, not what its own __str__ returns


def as_member(value: Any, members: Mapping[int, int]) -> int:
    return members[int(operator.index(value))]


def as_list(value: Any) -> list[Any]:
    """A copy. No generators: they would be empty when sent again."""
    if isinstance(value, str | bytes | bytearray | Mapping | Set) or not hasattr(value, "__len__"):
        raise TypeError(f"{type(value).__name__} is not a list")
    return list(value)


def as_dict(value: Any) -> dict[Any, Any]:
    if not isinstance(value, Mapping):
        raise TypeError(f"{type(value).__name__} is not a dict")
    return dict(value)


def as_tuple(value: Any, length: int) -> tuple[Any, ...]:
    if not isinstance(value, tuple) or len(value) != length:
        raise TypeError(f"not a tuple of {length}")
    return value
