"""Dictionaries of flat keys and values as two columns: one call handles all keys, and one all values.

    numbers     aligned, one after the other; bools and enumerators, too
    strings     uint32 length of all of them, uint32 flag, their UTF-8 with a NUL between two of them; if the flag is 1,
                some of them contain a NUL, and the number of characters of each (uint32) is in front

What is aligned is aligned from `origin`, modulo 8. A dictionary without entries has no columns.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection, Iterable
from itertools import accumulate, pairwise
from typing import Any, Protocol

from ..contract.types import BOOL, TIME, Dictionary, Enumeration, Primitive, Type
from .values import as_bool, as_member

Add = Callable[[bytes], object]


def has_columns(kind: Dictionary) -> bool:
    """Whether a dictionary can be written as columns."""
    return _is_flat(kind.key) and _is_flat(kind.value)


def _is_flat(kind: Type) -> bool:
    return isinstance(kind, Enumeration) or (isinstance(kind, Primitive) and kind is not TIME)


class ColumnDictionary:
    """Writes and reads the entries of one type of dictionary, behind their number."""

    def __init__(self, kind: Dictionary, origin: int = 0) -> None:
        self._keys, self._values = _column(kind.key, origin), _column(kind.value, origin)

    def write(self, entries: dict[Any, Any], n: int, add: Add) -> int:
        """Add the bytes of the entries, whose number ends at `n`; return where they end."""
        if not entries:
            return n
        return self._values.write(entries.values(), self._keys.write(entries, n, add), add)

    def read(self, data: memoryview, n: int, count: int) -> tuple[dict[Any, Any], int]:
        """The entries, and where they end. Raises ValueError if they are not there, and KeyError for an enumerator."""
        if not count:
            return {}, n
        keys, n = self._keys.read(data, n, count)
        values, n = self._values.read(data, n, count)
        return dict(zip(keys, values, strict=True)), n


class _Column(Protocol):
    def write(self, items: Collection[Any], n: int, add: Add) -> int: ...

    def read(self, data: memoryview, n: int, count: int) -> tuple[Iterable[Any], int]: ...


def _column(kind: Type, origin: int) -> _Column:
    match kind:
        case Primitive.STRING:
            return _Texts(origin)
        case Primitive.BOOL:
            return _Bools(origin)
        case Primitive():
            return _Numbers(kind.letter, origin)
        case Enumeration():
            return _Enumerators(kind, origin)
    raise AssertionError("not flat")


class _Numbers:
    """`struct` checks and converts them."""

    def __init__(self, letter: str, origin: int) -> None:
        self._letter, self._origin = letter, origin
        self._size = struct.calcsize(f"<{letter}")

    def write(self, items: Collection[Any], n: int, add: Add) -> int:
        padding = -n % self._size
        packed = struct.pack(f"<{padding}x{len(items)}{self._letter}", *items)
        add(packed)
        return n + len(packed)

    def read(self, data: memoryview, n: int, count: int) -> tuple[Iterable[Any], int]:
        begin = n + (self._origin - n) % self._size
        end = begin + count * self._size
        if end > data.nbytes:
            raise ValueError(f"{count} items of {self._size} bytes in {data.nbytes - n}")
        return struct.unpack_from(f"<{count}{self._letter}", data, begin), end


class _Bools(_Numbers):
    def __init__(self, origin: int) -> None:
        super().__init__(BOOL.letter, origin)

    def write(self, items: Collection[Any], n: int, add: Add) -> int:
        return super().write([item if item is True or item is False else as_bool(item) for item in items], n, add)

    def read(self, data: memoryview, n: int, count: int) -> tuple[Iterable[Any], int]:
        if max(data[n : n + count], default=0) > 1:
            raise ValueError("a bool is neither 0 nor 1")
        return super().read(data, n, count)


class _Enumerators(_Numbers):
    def __init__(self, kind: Enumeration, origin: int) -> None:
        super().__init__("i", origin)
        self._numbers = {number: number for _, number in kind.members}
        self._members = {number: kind.python(number) if kind.python else number for _, number in kind.members}

    def write(self, items: Collection[Any], n: int, add: Add) -> int:
        return super().write([as_member(item, self._numbers) for item in items], n, add)

    def read(self, data: memoryview, n: int, count: int) -> tuple[Iterable[Any], int]:
        numbers, end = super().read(data, n, count)
        return [self._members[number] for number in numbers], end


class _Texts:
    def __init__(self, origin: int) -> None:
        self._origin = origin
        self._lengths = _Numbers("I", origin)

    def write(self, items: Collection[Any], n: int, add: Add) -> int:
        joined = "\0".join(items)
        octets = joined.encode()
        has_nul = joined.count("\0") >= len(items)
        n = self._lengths.write((len(octets), has_nul), n, add)
        if has_nul:
            n = self._lengths.write([len(item) for item in items], n, add)
        add(octets)
        return n + len(octets)

    def read(self, data: memoryview, n: int, count: int) -> tuple[Iterable[Any], int]:
        (length, has_nul), n = self._lengths.read(data, n, 2)
        lengths: Iterable[int] = ()
        if has_nul:
            lengths, n = self._lengths.read(data, n, count)
        if length > data.nbytes - n:
            raise ValueError(f"strings of {length} bytes in {data.nbytes - n}")
        joined = str(data[n : n + length], "utf-8")
        texts = _cut(joined, lengths) if has_nul else joined.split("\0")
        if len(texts) != count:
            raise ValueError(f"{len(texts)} strings instead of {count}")
        return texts, n + length


def _cut(joined: str, lengths: Iterable[int]) -> list[str]:
    """Texts of these lengths with a character between two of them."""
    begins = [0, *accumulate(length + 1 for length in lengths)]
    if begins[-1] != len(joined) + 1:
        raise ValueError("the lengths of strings do not fit")
    return [joined[begin : end - 1] for begin, end in pairwise(begins)]
