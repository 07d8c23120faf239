"""Limits the items of a message, so that a few octets cannot become gigabytes of Python objects.

An item is an element of a sequence or an entry of a dictionary. Numbers in arrays do not count, because an array is
one object. A received item takes up to 300 octets and a microsecond, but its sender may need only one octet.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter, itemgetter
from typing import Any

from ..contract.types import Dictionary, Enumeration, Primitive, Sequence, Struct, Type

MAX_ITEMS = 1024 * 1024
"""A message with more items is refused by both sides."""

Left = list[int]
"""Its only element is the number of items that a message may still have."""

Count = Callable[[Any], int]


class TooManyItems(ValueError):
    """A message has more items than allowed."""


def take_items(left: Left, count: int) -> None:
    """Subtract this number from the items that are left. Raises TooManyItems if fewer are left."""
    left[0] -= count
    if left[0] < 0:
        raise TooManyItems(f"a message may have {MAX_ITEMS} items in its sequences and dictionaries")


def check_items(message: Struct, values: tuple[Any, ...]) -> None:
    """Raise TooManyItems if these values, which fit the message's type, have too many."""
    counts = [counter(field.type) for field in message.fields]
    take_items([MAX_ITEMS], sum(count(value) for count, value in zip(counts, values, strict=True) if count))


def counter(kind: Type) -> Count | None:
    """A function that counts the items in values of a type; None if they have none."""
    return _counter(kind, {})


def _counter(kind: Type, known: dict[int, Count | None]) -> Count | None:
    """The same; `known` are those made already, by the identity of the type: many types may share a part."""
    if id(kind) not in known:
        known[id(kind)] = _made(kind, known)
    return known[id(kind)]


def _made(kind: Type, known: dict[int, Count | None]) -> Count | None:
    match kind:
        case Primitive() | Enumeration():
            return None
        case Struct(fields=fields, python=python):
            parts = [
                (attrgetter(field.attribute) if python else itemgetter(number), count)
                for number, field in enumerate(fields)
                if (count := _counter(field.type, known))
            ]
            return (lambda value: sum(count(part(value)) for part, count in parts)) if parts else None
        case Sequence(item):
            if kind.dtype is not None:
                return None
            inside = _counter(item, known)
            return _with(inside, iter) if inside else len
        case Dictionary(_, item):
            inside = _counter(item, known)
            return _with(inside, _values) if inside else len


def _with(inside: Count, parts: Callable[[Any], Any]) -> Count:
    return lambda value: len(value) + sum(map(inside, parts(value)))


def _values(entries: Any) -> Any:
    return entries.values()
