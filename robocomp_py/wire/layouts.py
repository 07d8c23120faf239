"""Where the fields of records lie in CDR and Ice payloads, as numpy dtypes.

In CDR, alignment counts from the beginning of the message. So all records from the second on have the same layout; the
first may have less padding. In nearly all structs it has not, and an array of records is then a view of the payload.
Records of other layouts are copied field by field.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ..contract.types import UINT16, UINT32, Enumeration, Primitive, Struct
from .arrays import read_only
from .records import Records, records
from .values import RANGES

_Array = np.ndarray[Any, np.dtype[Any]]


class CdrRecords:
    """Records of a flat struct in CDR. Alignment counts from `origin`, modulo 8."""

    def __init__(self, kind: Struct, origin: int = 0) -> None:
        self._records = records(kind)
        self._origin = origin
        self._layouts = [_layout(self._records.dtype, start) for start in range(8)]

    def write(self, array: _Array, n: int, add: Callable[[Any], object]) -> int:
        """Add the bytes of an array of records, whose count ends at `n`; return where they end."""
        count = array.size
        if not count:
            return n
        layout = self._layouts[(n - self._origin) & 7]
        if layout.is_packed:
            if layout.begin:
                add(bytes(layout.begin))
            add(array.view(np.uint8))
            return n + layout.begin + array.nbytes
        octets = np.zeros(layout.size(count), np.uint8)
        for records_, place in layout.parts(octets, 0, count):
            for name in self._records.dtype.names or ():
                records_[name] = array[place][name]
        add(octets)
        return n + octets.nbytes

    def read(self, data: Any, n: int, count: int) -> tuple[_Array, int]:
        """The records after a count, read-only, and where they end. Raises ValueError if the payload is too short."""
        dtype = self._records.dtype
        if not count:
            return read_only(np.empty(0, dtype)), n
        layout = self._layouts[(n - self._origin) & 7]
        end = n + layout.size(count)
        if end > len(data):
            raise ValueError(f"{count} records of {dtype.itemsize} bytes exceed the payload")
        if layout.is_packed:
            array = np.frombuffer(data, dtype, count, n + layout.begin)
        else:
            parts = list(layout.parts(data, n, count))
            array = parts[0][0] if len(parts) == 1 else _joined(dtype, parts, count)
        array = self._records.checked(array)
        return (read_only(array) if array.flags.writeable else array), end


class _Layout(NamedTuple):
    """The layout of records that begin at some offset."""

    first: np.dtype[np.void]
    begin: int
    end: int
    """Where the first begins, after its padding, and where it ends."""
    others: np.dtype[np.void]
    gap: int
    """The padding in front of each of the others."""
    stride: int
    is_regular: bool
    """Whether the first has the same layout as the others."""
    is_packed: bool
    """Whether there is no padding in and between them."""

    def size(self, count: int) -> int:
        return self.end + (count - 1) * self.stride

    def parts(self, data: Any, n: int, count: int) -> Iterator[tuple[_Array, slice]]:
        """Views of the records: one of all, or one of the first and one of the others."""
        together = count if self.is_regular else 1
        yield np.ndarray((together,), self.first, data, n + self.begin, (self.stride,)), slice(together)
        if together < count:
            begin = n + self.end + self.gap
            yield np.ndarray((count - 1,), self.others, data, begin, (self.stride,)), slice(1, count)


@cache
def _layout(dtype: np.dtype[np.void], start: int) -> _Layout:
    first, begin, end = _one(dtype, start)
    others, second, behind = _one(dtype, end)
    regular = second - begin == behind - end and first == others
    packed = regular and first == dtype and behind - end == dtype.itemsize
    return _Layout(
        first, begin - start, end - start, others, second - end, behind - end, is_regular=regular, is_packed=packed
    )


def _one(dtype: np.dtype[np.void], start: int) -> tuple[np.dtype[np.void], int, int]:
    """The layout of a record that begins at `start`, where its first field begins, and where it ends."""
    offsets, at = [], start
    formats = [dtype[name] for name in dtype.names or ()]
    for each in formats:
        at += -at % each.itemsize
        offsets.append(at)
        at += each.itemsize
    begin = offsets[0]
    layout = {
        "names": dtype.names,
        "formats": formats,
        "offsets": [offset - begin for offset in offsets],
        "itemsize": at - begin,
    }
    return np.dtype(layout), begin, at  # type: ignore[call-overload]  # names may be a tuple, too


def _joined(dtype: np.dtype[np.void], parts: list[tuple[_Array, slice]], count: int) -> _Array:
    array = np.empty(count, dtype)
    for part, place in parts:
        for name in dtype.names or ():
            array[name][place] = part[name]
    return array


class IceRecords:
    """Records of a flat struct in Ice, which has no padding, but carries unsigned numbers as wider types."""

    def __init__(self, kind: Struct) -> None:
        self._records: Records = records(kind)
        self._limits = [(f.attribute, RANGES[f.type]) for f in kind.fields if f.type is UINT16 or f.type is UINT32]
        self.dtype = np.dtype([(f.attribute, _wire(f.type)) for f in kind.fields])
        self._is_same = self.dtype == self._records.dtype

    def octets(self, array: _Array) -> _Array:
        """The bytes of an array of records."""
        if not self._is_same:
            wider = np.empty(array.size, self.dtype)
            for name in self.dtype.names or ():
                wider[name] = array[name]
            array = wider
        return array.view(np.uint8)

    def read(self, data: Any, n: int, count: int) -> tuple[_Array, int]:
        """The records after a size, read-only, and where they end. Raises ValueError if the payload is too short."""
        end = n + count * self.dtype.itemsize
        if end > len(data):
            raise ValueError(f"{count} records exceed the payload")
        found = np.frombuffer(bytes(data[n:end]), self.dtype)  # copied: nothing is aligned there
        found = self._records.checked(found)
        if self._is_same:
            return found, end
        array = np.empty(count, self._records.dtype)
        for name, (low, high) in self._limits if count else ():
            if found[name].min() < low or found[name].max() > high:
                raise ValueError(f"`{name}` is not from {low} to {high}")
        for name in self.dtype.names or ():
            array[name] = found[name]
        return read_only(array), end


def _wire(kind: Any) -> str:
    match kind:
        case Enumeration():
            return "u1"
        case Primitive.UINT16:
            return "<i4"
        case Primitive.UINT32:
            return "<i8"
        case Primitive(letter=letter):
            return f"<{letter}"
    raise AssertionError("not flat")
