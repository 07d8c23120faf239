"""Parts of messages by their paths, and conditions on them. What does not fit a contract is noticed at once.

A message is JSON here, as `wire.json.show_fields` makes it.
"""

from __future__ import annotations

import json
import math
import operator
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from ..contract import types
from ..contract.types import BOOL, FLOATS, INTEGERS, STRING, TIME, UINT8, Dictionary, Enumeration, Field, Struct, Type
from ..fieldpath import Wide, wide_steps
from ..spelling import unknown

_OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq,
    "=": operator.eq,
    "!=": operator.ne,
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}

_CONDITION = re.compile(r"\s*([^\s=!<>]+)\s*(==|!=|<=|>=|=|<|>)\s*(.*?)\s*", re.DOTALL)

_ABSENT = object()
"""Stands for what a message has not: an item behind the end of a sequence, or a key."""


class Reached(NamedTuple):
    """One level of a path."""

    spelt: str
    """The path so far."""
    type: Type
    step: str | int | Wide
    place: int | None
    """The number of the field or item in decoded values; None for a key of a dictionary, and for all items."""


@dataclass(frozen=True)
class Part:
    """A part of the messages of one contract."""

    path: str
    type: Type
    """With `[*]` in its path, that of each."""
    steps: tuple[str | int | Wide, ...]

    def of(self, message: Any) -> Any:
        """Its value; a list with `[*]` in its path; None if it is absent."""
        return _plain(_found(message, self.steps))

    def each(self, message: Any) -> Iterator[Any]:
        """The values that are there: with `[*]`, those of all items."""
        yield from _flat(_found(message, self.steps), self.steps.count(Wide.ITEMS))


@dataclass(frozen=True)
class Condition:
    """`light.power > 3`. With `[*]` in its path, one item that fits is enough."""

    part: Part
    compare: Callable[[Any, Any], bool]
    literal: Any

    def fits(self, message: Any) -> bool:
        return any(self.compare(_comparable(self.part.type, each), self.literal) for each in self.part.each(message))


def walk(fields: Sequence[Field], steps: Sequence[str | int | Wide]) -> Iterator[Reached]:
    """The levels of a path, one after the other, except for a last `*`. Raises ValueError.

    The name of an only parameter may be left out if it is a struct.
    """
    only = fields[0] if len(fields) == 1 else None
    if only and isinstance(only.type, Struct) and steps[0] not in (only.name, Wide.FIELDS):
        steps = [only.name, *steps]
    kind: Type = Struct("a message", tuple(fields))
    spelt = ""
    place: int | None
    for each in steps:
        place = None
        match kind, each:
            case Struct(), Wide.FIELDS:
                return
            case Struct(fields=inner), str(name):
                known = [one.name for one in inner]
                if name not in known:
                    where = f"`{spelt}`: " if spelt else ""
                    raise ValueError(f"{where}{unknown('field', name, known)}")
                place = known.index(name)
                kind, spelt = inner[place].type, f"{spelt}.{name}" if spelt else name
            case types.Sequence(item), int(place):
                kind, spelt = item, f"{spelt}[{place}]"
            case types.Sequence(item), Wide.ITEMS:
                kind, spelt = item, f"{spelt}[*]"
            case types.Sequence(), Wide.FIELDS:
                raise ValueError(f"`{spelt}` is a sequence; write {spelt}[0].*")
            case types.Sequence(), _:
                raise ValueError(f"`{spelt}` is a sequence; write {spelt}[0].{each}")
            case Dictionary(_, item), str() | int():
                kind, spelt = item, f"{spelt}.{each}" if isinstance(each, str) else f"{spelt}[{each}]"
            case _:
                has_no = f"item {each}" if isinstance(each, int) else "items" if each is Wide.ITEMS else "fields"
                raise ValueError(f"`{spelt or 'a message'}` is {_word(kind)}, and has no {has_no}")
        yield Reached(spelt, kind, each, place)


def parts(fields: Sequence[Field], path: str) -> list[Part]:
    """What a path names in messages with these fields; several if it ends with `*`. Raises ValueError."""
    steps = wide_steps(path)
    reached = list(walk(fields, steps))
    taken = tuple(each.step for each in reached)
    spelt, kind = (reached[-1].spelt, reached[-1].type) if reached else ("", Struct("", tuple(fields)))
    if steps[-1] is Wide.FIELDS and isinstance(kind, Struct):
        return list(_leaves(spelt, taken, kind))
    for each in reached[:-1]:
        if isinstance(each.type, types.Sequence) and each.type.item is UINT8:
            raise ValueError(f"`{each.spelt}` holds octets, which are shown in base64 as a whole")
    return [Part(spelt, kind, taken)]


def condition(fields: Sequence[Field], text: str) -> Condition:
    """What `--where` means for messages with these fields. Raises ValueError."""
    found = _CONDITION.fullmatch(text)
    if found is None:
        raise ValueError(f"`{text}` is no condition; write a path, one of = != < <= > >=, and a value: a.b>3")
    path, sign, literal = found.groups()
    if path.endswith("*"):
        raise ValueError(f"`{path}` names several fields; compare one of them")
    (part,) = parts(fields, path)
    return Condition(part, _OPERATORS[sign], _literal(part, sign, literal))


def _literal(part: Part, sign: str, text: str) -> Any:
    kind = part.type
    if kind in FLOATS or kind in INTEGERS or kind is TIME:
        return _number(part, text)
    if not (kind is BOOL or kind is STRING or isinstance(kind, Enumeration)):
        hint = f"; compare one of its items, {part.path}[0], or any of them, {part.path}[*]"
        hint = hint if isinstance(kind, types.Sequence) and kind.item is not UINT8 else ""
        raise ValueError(f"`{part.path}` is {_word(kind)}, and is not compared{hint}")
    if sign not in ("=", "==", "!="):
        raise ValueError(f"`{part.path}` is {_word(kind)}; compare it by = or !=")
    if isinstance(kind, Enumeration):
        names = [name for name, _ in kind.members]
        if text not in names:
            raise ValueError(f"`{part.path}` is one of {', '.join(names)}, and not `{text}`")
    elif kind is BOOL:
        if text not in ("true", "false"):
            raise ValueError(f"`{part.path}` is true or false, and not `{text}`")
        return text == "true"
    return _text(text) if kind is STRING else text


def _number(part: Part, text: str) -> float:
    try:
        number = int(text) if re.fullmatch(r"[+-]?\d{1,30}", text) else float(text)
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise ValueError(f"`{part.path}` is {_word(part.type)}; compare it with a number, and not `{text}`")
    return number


def _text(text: str) -> str:
    """Text as it is, or in quotes as in JSON."""
    if text.startswith('"'):
        try:
            return str(json.loads(text))
        except ValueError as exc:
            raise ValueError(f"`{text}` is no text in quotes: {exc}") from exc
    return text


def _comparable(kind: Type, value: Any) -> Any:
    return float(value) if kind in FLOATS else value  # NaN and infinities are texts in JSON


def _leaves(spelt: str, steps: tuple[str | int | Wide, ...], kind: Struct) -> Iterator[Part]:
    for field in kind.fields:
        path, further = f"{spelt}.{field.name}" if spelt else field.name, (*steps, field.name)
        if isinstance(field.type, Struct):
            yield from _leaves(path, further, field.type)
        else:
            yield Part(path, field.type, further)


def _found(value: Any, steps: Sequence[str | int | Wide]) -> Any:
    for number, each in enumerate(steps):
        if each is Wide.ITEMS:
            return [_found(item, steps[number + 1 :]) for item in value]
        key = str(each) if isinstance(value, dict) else each
        try:
            value = value[key]
        except (KeyError, IndexError):
            return _ABSENT
    return value


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return None if value is _ABSENT else value


def _flat(value: Any, levels: int) -> Iterator[Any]:
    if value is _ABSENT:
        return
    if levels:
        for each in value:
            yield from _flat(each, levels - 1)
    else:
        yield value


def _word(kind: Type) -> str:
    match kind:
        case types.Sequence(item):
            return f"a sequence of {_word(item)}"
        case Dictionary():
            return "a dictionary"
        case _:
            return types.spell(kind).replace("::", ".")
