"""Which Python values fit a sequence of numbers or bools, and as which arrays they arrive; the same for all codecs.

This module needs numpy, whose import takes longer than all else that a tool needs for a message. So codecs import it
only for messages that have arrays.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any

import numpy as np

_Array = np.ndarray[Any, np.dtype[Any]]


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
