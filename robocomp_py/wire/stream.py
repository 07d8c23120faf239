"""Reads MessagePack piece by piece, guided by the contract, so that unexpected content takes little memory.

If a message were unpacked before it is checked, the sender would decide how large it becomes: one octet can become 112
octets of objects, and three can claim a list of 65535. So the library first skips each value, which takes no memory
and fails if octets are missing. It then unpacks at most 64 KiB, which are checked at once.

Larger values are read in parts: the items of a container are counted before they are read, and a container in place
of a scalar is refused at its first octet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import msgpack

from ..contract.types import STRING, Dictionary, Field, Sequence, Struct, Type
from .items import MAX_ITEMS, Count, counter, take_items
from .plain import NUMBERS, Entries, Frames, ReadArray, compile_reader

PIECE = 64 * 1024
"""The most octets that are unpacked before a check. They become at most 8 MB."""

_MOST_OF_A_PIECE = PIECE - PIECE // 16

SHORT = 2 * 1024
_FEW = 512
"""If no list has more items, a message of 2 KiB becomes at most 3 MB, whatever it claims to hold."""

_HEAD = 5
"""The octets of the longest head of a container."""

_LISTS = frozenset((*range(0x90, 0xA0), 0xDC, 0xDD))
"""The octets that lists begin with."""


def unpack_piece(packed: Any) -> Any:
    """The tree of a message that is no larger than a piece."""
    if len(packed) <= SHORT:
        try:
            return msgpack.unpackb(packed, strict_map_key=False, max_array_len=_FEW)
        except ValueError:
            pass  # a longer list, which may be right, or an error, which is found again below
    unpacker = msgpack.Unpacker(max_buffer_size=len(packed))
    unpacker.feed(packed)
    unpacker.skip()
    return msgpack.unpackb(packed, strict_map_key=False)


def has_dictionary(kind: Type, known: dict[int, bool]) -> bool:
    """Whether a value is a dictionary of texts, or a struct that has one. These are read faster in parts.

    The library interns each text that is a key, which takes longer than reading the keys as a list. `known` holds the
    structs that were already examined, by identity: many types may share a part.
    """
    if isinstance(kind, Struct):
        if id(kind) not in known:
            known[id(kind)] = any([has_dictionary(field.type, known) for field in kind.fields])
        return known[id(kind)]
    return isinstance(kind, Dictionary) and kind.key is STRING


def compile_stream_reader(message: Struct, array: ReadArray, *, prefix: bool) -> Callable[[Frames], tuple[Any, ...]]:
    """A function from a payload to a message's fields. If anything is wrong, it raises an exception."""
    parts = _Parts(array)

    def read(frames: Frames) -> tuple[Any, ...]:
        source = _Source(frames, parts)
        values = source.fields(message, prefix)
        if not prefix:
            source.check_end()
        return tuple(values)

    return read


@dataclass(frozen=True, slots=True)
class _Part:
    """For some types: a function that reads unpacked values, and one that counts their items."""

    read: Callable[[Any, Frames], tuple[Any, ...]]
    count: Count | None


class _Parts:
    """The types in a message. The reader of each is compiled when it is first needed."""

    def __init__(self, array: ReadArray) -> None:
        self._array = array
        self._known: dict[tuple[int, ...], _Part] = {}
        self._with_dictionary: dict[int, bool] = {}

    def of(self, kinds: tuple[Type, ...]) -> _Part:
        key = tuple(map(id, kinds))  # types live as long as their message does
        if key not in self._known:
            row = Struct("", tuple(Field("value", kind) for kind in kinds))
            self._known[key] = _Part(compile_reader(row, self._array, prefix=False), counter(row))
        return self._known[key]

    def has_dictionary(self, kind: Type) -> bool:
        return has_dictionary(kind, self._with_dictionary)


class _Source:
    """A packed message that is read from its beginning to its end."""

    def __init__(self, frames: Frames, parts: _Parts) -> None:
        self._frames, self._parts = frames, parts
        self._packed = memoryview(frames[0])
        self._at = 0
        self._left = [MAX_ITEMS]

    def fields(self, kind: Struct, prefix: bool = False) -> list[Any]:
        """The values of a struct's fields; with `prefix`, it may have more."""
        expected, found = len(kind.fields), self._head(msgpack.Unpacker.read_array_header)
        if found < expected or (found > expected and not prefix):
            raise ValueError(f"expected {expected} values, found {found}")
        values: list[Any] = []
        for in_parts, group in groupby((field.type for field in kind.fields), self._parts.has_dictionary):
            kinds = tuple(group)
            values += map(self._enter, kinds) if in_parts else self._values(kinds)
        return values

    def check_end(self) -> None:
        rest = len(self._packed) - self._at
        if rest:
            raise ValueError(f"{rest} bytes left over")

    def _values(self, kinds: tuple[Type, ...]) -> Iterable[Any]:
        """The next values, of these types: together, if one piece has them all."""
        trees = self._unpack(1, len(kinds))
        if trees:
            return self._checked(kinds, trees)
        if len(kinds) > 1:
            return [self._value(kind) for kind in kinds]
        return [self._enter(kinds[0])]

    def _value(self, kind: Type) -> Any:
        (value,) = self._values((kind,))
        return value

    def _enter(self, kind: Type) -> Any:
        """The next value, read in parts."""
        match kind:
            case Struct(python=python):
                return python(*self.fields(kind)) if python else tuple(self.fields(kind))
            case Sequence(item) if kind.dtype is None:
                return self._list(kind, item)
            case Dictionary(key, item):
                return self._dict(kind, key, item)
            case Sequence() if self._packed[self._at] in _LISTS:
                tree: Any = self._numbers()
            case _:
                tree = self._leaf()
        (value,) = self._checked((kind,), [tree])
        return value

    def _list(self, kind: Sequence, item: Type) -> list[Any]:
        count = self._head(msgpack.Unpacker.read_array_header)
        take_items(self._left, count)
        values: list[Any] = []
        while len(values) < count:
            trees = self._unpack(count - len(values), 1)
            if trees:
                (some,) = self._checked((kind,), [trees], counted=len(trees))
                values += some
            else:
                values.append(self._value(item))
        return values

    def _dict(self, kind: Dictionary, key: Type, item: Type) -> dict[Any, Any]:
        count = self._head(msgpack.Unpacker.read_map_header)
        take_items(self._left, count)
        values: dict[Any, Any] = {}
        while count:
            trees = self._unpack(count, 2)
            if trees:
                entries = Entries(trees)
                (some,) = self._checked((kind,), [entries], counted=len(trees) // 2)
                values.update(some)
                count -= len(trees) // 2
            else:
                name = self._value(key)
                values[name] = self._value(item)
                count -= 1
        return values

    def _head(self, read: Callable[[Any], int]) -> int:
        """How many items the container has that begins here."""
        unpacker = msgpack.Unpacker(max_buffer_size=_HEAD)
        unpacker.feed(self._packed[self._at : self._at + _HEAD])
        count = read(unpacker)
        self._at += unpacker.tell()
        return count

    def _unpack(self, most: int, parts: int) -> list[Any]:
        """The trees of at most `most` values, each of `parts` trees. None if the first exceeds a piece."""
        rest = len(self._packed) - self._at
        piece = self._packed[self._at : self._at + PIECE]
        # the average tells how many are probably in one piece
        count = most if rest <= PIECE else min(most, most * _MOST_OF_A_PIECE // rest or 1)
        while count:
            head = b"\xdd" + (count * parts).to_bytes(4, "big")
            unpacker = msgpack.Unpacker(max_buffer_size=len(head) + len(piece))
            unpacker.feed(head)
            unpacker.feed(piece)
            try:
                unpacker.skip()
            except msgpack.OutOfData:
                count //= 4
                continue
            size = unpacker.tell() - len(head)
            self._at += size
            trees: list[Any] = msgpack.unpackb(b"".join((head, piece[:size])), strict_map_key=False)
            return trees
        return []

    def _checked(self, kinds: tuple[Type, ...], trees: list[Any], counted: int = 0) -> tuple[Any, ...]:
        """The values of trees, checked against these types. `counted` of their items are already counted."""
        part = self._parts.of(kinds)
        values = part.read(trees, self._frames)
        if part.count and len(self._packed) > MAX_ITEMS:  # each item has an octet at least, so few messages are counted
            take_items(self._left, max(0, part.count(values) - counted))
        return values

    def _numbers(self) -> list[Any]:
        """A list of numbers in place of an array."""
        count = self._head(msgpack.Unpacker.read_array_header)
        take_items(self._left, count)
        numbers: list[Any] = []
        while len(numbers) < count:
            trees = self._unpack(count - len(numbers), 1)
            if not trees or not set(map(type, trees)) <= NUMBERS:
                raise ValueError("expected an array of numbers, found a list of something else")
            numbers += trees
        return numbers

    def _leaf(self) -> Any:
        """A text or an array that is larger than a piece; containers are not unpacked."""
        packed = self._packed[self._at :]
        unpacker = msgpack.Unpacker(
            _Pieces(packed), read_size=PIECE, max_buffer_size=len(packed) + PIECE, max_array_len=0, max_map_len=0
        )
        leaf = unpacker.unpack()
        self._at += unpacker.tell()
        return leaf


class _Pieces:
    """A packed message as a file, so that a message refused early is not copied completely."""

    def __init__(self, packed: memoryview) -> None:
        self._rest = packed

    def read(self, most: int) -> bytes:
        piece, self._rest = self._rest[:most], self._rest[most:]
        return bytes(piece)
