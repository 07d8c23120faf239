"""Which Python values fit a type, and as which values they arrive; the same for all codecs.

    bool          bool, numpy's bool
    integers      int and everything `operator.index` accepts (numpy's integers, enumerators, bool), in range
    floats        float and everything `struct` packs as one (int, numpy's numbers); a float32 is rounded, and
                  never becomes infinite
    string        str that encodes to UTF-8
    time          as int64, within ROS 2's range
    enumeration   an integer that is one of its members
    struct        any object with its attributes; one without a Python class: a tuple
    sequence      of numbers and bools: see `as_array`; with `records`, and of other flat structs: see `Records.taken`;
                  others: list, tuple, anything with a length and an order
    dictionary    any mapping

Compiled encoders test for the plainest type first and call these functions for other types. If one
raises an exception, `explain.explain` calls them again, field by field, to find the reason.
"""

from __future__ import annotations

import operator
import struct
from collections.abc import Mapping, Set
from typing import Any

import numpy as np

from ..contract.types import Primitive, integer_range

RANGES = {kind: integer_range(kind) for kind in Primitive if kind.python is int}
"""Smallest and largest value of each type that is an int in Python."""

_Array = np.ndarray[Any, np.dtype[Any]]

_SINGLE, _DOUBLE = struct.Struct("<f"), struct.Struct("<d")


def as_bool(value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
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


def as_array(value: Any, dtype: np.dtype[Any]) -> _Array:
    """A contiguous one-dimensional array of that dtype, sharing the memory of `value` where it can.

    It accepts arrays and buffers (several dimensions are flattened in C order), flat lists, tuples and
    ranges of numbers, and bytes for octets. No value is rounded to an integer or wrapped: a value
    out of range raises OverflowError, one of another kind TypeError.
    """
    if type(value) is np.ndarray and value.dtype is dtype and value.ndim == 1 and value.strides[0] == dtype.itemsize:
        return value  # nearly all arrays, found by the fastest test
    if isinstance(value, np.ndarray) and value.dtype == dtype and value.ndim:
        if value.ndim == 1 and value.flags.c_contiguous:
            return value
        return np.ascontiguousarray(value).reshape(-1)
    if isinstance(value, bytes | bytearray):
        if dtype != np.uint8:
            raise TypeError(f"{type(value).__name__} is for sequences of octets")
        return np.frombuffer(value, dtype)
    array = _gathered(value)
    if array.dtype != dtype and array.size:
        _check_convertible(array, dtype)
    with np.errstate(over="raise"):
        try:
            result = np.ascontiguousarray(array, dtype)
        except FloatingPointError as exc:
            raise OverflowError(f"values exceed {dtype.name}") from exc
    ours = array.dtype != dtype or isinstance(value, list | tuple | range)  # so `snapshot` need not copy it again
    return (read_only(result) if ours else result).reshape(-1)


def _gathered(value: Any) -> _Array:
    if isinstance(value, str | Mapping | Set) or not (hasattr(value, "__len__") or hasattr(value, "__array__")):
        raise TypeError(f"{type(value).__name__} is not an array")
    array = np.asarray(value)
    if array.ndim == 0 or (array.ndim > 1 and not hasattr(value, "ndim")):
        raise TypeError(f"{array.ndim} dimensions")
    return array


def _check_convertible(array: _Array, dtype: np.dtype[Any]) -> None:
    kind = array.dtype.kind
    if kind not in {"b": "b", "i": "iu", "u": "iu", "f": "iuf"}[dtype.kind]:
        raise TypeError(f"{array.dtype} values")
    if dtype.kind in "iu":
        low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
        if int(array.min()) < low or int(array.max()) > high:
            raise OverflowError(f"values from {array.min()} to {array.max()}")


def snapshot(value: Any, dtype: np.dtype[Any]) -> _Array:
    """`as_array`, read-only, and sharing no memory that is still writable."""
    array = as_array(value, dtype)
    if array.flags.writeable or not is_frozen(array):  # most are writeable, and this is the faster test
        # numpy copies structured arrays item by item, so these are copied as octets
        copied = (array.view(np.uint8) if dtype.names else array).copy()
        copied.flags.writeable = False
        array = copied.view(dtype) if dtype.names else copied
    return array


def is_frozen(owner: Any) -> bool:
    """Whether this memory is read-only: through this object, and through the object it is a view of."""
    while isinstance(owner, np.ndarray | memoryview):
        if isinstance(owner, memoryview):
            writable, owner = not owner.readonly, owner.obj
        else:
            writable, owner = owner.flags.writeable, owner.base
        if writable:
            return False
    # None: the array owned its memory; `frozen`: memory that a transport lends for reading
    return owner is None or isinstance(owner, bytes) or bool(getattr(owner, "frozen", False))


def view_of(data: Any, dtype: np.dtype[Any], count: int, offset: int) -> _Array:
    """A read-only array over received bytes, without a copy; it keeps the bytes alive.

    Raises ValueError if the payload is too short, or if a bool is neither 0 nor 1.
    """
    if not count:
        return read_only(np.empty(0, dtype))
    if dtype.kind == "b" and np.any(np.frombuffer(data, np.uint8, count, offset) > 1):
        raise ValueError("a bool is neither 0 nor 1")
    array = np.frombuffer(data, dtype, count, offset)
    return read_only(array) if array.flags.writeable else array


def read_only(array: _Array) -> _Array:
    array.flags.writeable = False
    return array
