"""An operation from its canonical text, as other processes announce it: types without generated code.

The text comes from outside, so everything in it is checked, and nothing of it becomes code. It has no comments, no
defaults, no names of sequences and no bases of exceptions, and does not say whether an operation is idempotent.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from .interface import Operation, Pattern
from .types import MAX_DEPTH, Dictionary, Enumeration, ExceptionType, Field, Primitive, Sequence, Struct, Type, is_key

LONGEST = 65536
"""Maximum number of characters in a text."""

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*(::[A-Za-z_][A-Za-z0-9_-]*)*\Z")
_GENERIC = re.compile(r"(sequence|records|dictionary)<(.*)>\Z")

_PRIMITIVES = {str(kind.value): kind for kind in Primitive}

_Members = list[tuple[str, str]]


@dataclass(frozen=True)
class Supplement:
    """The parts of an operation that its text does not contain."""

    idempotent: bool = False
    confirm: bool = False
    bases: Mapping[str, tuple[tuple[str, int], ...]] = field(default_factory=dict)
    """By the name of an exception: the name of each base and the number of all its fields, the nearest base first."""


def supplement(operation: Operation[Any]) -> Supplement:
    bases = {each.name: tuple(_bases(each)) for each in operation.raises if each.base}
    return Supplement(operation.idempotent, operation.confirm, bases)


def _bases(kind: ExceptionType) -> Iterator[tuple[str, int]]:
    if kind.base:
        yield kind.base.name, len(kind.base.all_fields)
        yield from _bases(kind.base)


def completed(operation: Operation[Any], more: Supplement) -> Operation[Any]:
    """An operation that was made from its text, with the parts that the text does not contain. Raises ValueError."""
    raises = tuple(_with_bases(each, more.bases.get(each.name, ())) for each in operation.raises)
    return replace(operation, idempotent=more.idempotent, confirm=more.confirm, raises=raises)


def _with_bases(kind: ExceptionType, bases: tuple[tuple[str, int], ...]) -> ExceptionType:
    if not bases:
        return kind
    name, at = bases[0]
    base = _with_bases(ExceptionType(_named(name), kind.fields[:at]), bases[1:])
    return ExceptionType(kind.name, kind.fields[at:], base)


def operation(text: str) -> Operation[Any]:
    """The operation whose `text` this is. Its structs have no classes: their values are tuples of their fields.

    Raises ValueError if the text is not one that a version of this package writes.
    """
    if len(text) > LONGEST:
        raise ValueError(f"the contract has {len(text)} characters; at most {LONGEST} are read")
    try:
        found = _operation(text)
    except (KeyError, IndexError, RecursionError) as exc:
        raise ValueError(f"{type(exc).__name__}: {exc}") from exc
    if found.text != text:
        raise ValueError("it is not what its own parts describe")
    return found


def _operation(text: str) -> Operation[Any]:
    first, *rest = text.split("\n")
    interface, _, name = _after("operation ", first).rpartition(".")
    pattern = _after("pattern ", rest[0] if rest else "")
    sections = _sections(rest[1:])
    (request, inputs), (response, outputs) = sections[0], sections[1]
    if not (request.startswith("struct ") and response.startswith("struct ")):
        raise ValueError("its messages are missing")
    types = _Types(dict(sections[2:]))
    return Operation(
        _named(interface),
        _named(name),
        types.fields(inputs),
        types.fields(outputs),
        tuple(
            ExceptionType(_named(_after("exception ", head)), types.fields(members))
            for head, members in sections[2:]
            if head.startswith("exception ")
        ),
        None if pattern == "unspecified" else Pattern(pattern),
    )


def _after(word: str, line: str) -> str:
    if not line.startswith(word):
        raise ValueError(f"{word.strip()} is missing")
    return line.removeprefix(word)


def _named(name: str) -> str:
    if not _NAME.match(name):
        raise ValueError(f"{name[:40]!r} is no name")
    return name


def _sections(lines: list[str]) -> list[tuple[str, _Members]]:
    """Each head with its members: a name, and a type or number."""
    sections: list[tuple[str, _Members]] = []
    for line in lines:
        if line.startswith("  "):
            name, _, rest = line[2:].partition(" ")
            sections[-1][1].append((_named(name), rest))
        else:
            sections.append((line, []))
    return sections


class _Types:
    """The types that a text describes, made when they are first used."""

    def __init__(self, described: Mapping[str, _Members]) -> None:
        self._described = described
        self._made: dict[str, Type] = {}

    def fields(self, members: _Members, depth: int = 0) -> tuple[Field, ...]:
        return tuple(Field(name, self._type(kind, depth)) for name, kind in members)

    def _type(self, spelt: str, depth: int) -> Type:
        if depth > MAX_DEPTH:
            raise ValueError(f"its types are nested more than {MAX_DEPTH} deep")
        if spelt in _PRIMITIVES:
            return _PRIMITIVES[spelt]
        if generic := _GENERIC.match(spelt):
            return self._generic(generic[1], generic[2], depth + 1)
        if spelt not in self._made:
            self._made[spelt] = self._user_type(_named(spelt), depth + 1)
        return self._made[spelt]

    def _generic(self, kind: str, inside: str, depth: int) -> Type:
        if kind == "dictionary":
            key, _, value = inside.partition(",")  # a key is no generic, so it has no comma
            made = Dictionary(self._type(key, depth), self._type(value, depth))
            if not is_key(made.key):
                raise ValueError(f"{key[:40]!r} is no key")
            return made
        return Sequence(self._type(inside, depth), records=kind == "records")

    def _user_type(self, name: str, depth: int) -> Type:
        if (members := self._described.get(f"enum {name}")) is not None:
            return Enumeration(name, tuple((member, int(number)) for member, number in members))
        return Struct(name, self.fields(self._described[f"struct {name}"], depth))
