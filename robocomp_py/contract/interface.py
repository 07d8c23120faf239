"""Interfaces and their operations, and the fingerprint by which two sides know they mean the same."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from .types import Enumeration, ExceptionType, Field, Response, Struct, spell, walk

if TYPE_CHECKING:
    from .action import Action

R = TypeVar("R")


class Pattern(StrEnum):
    """How an operation travels."""

    COMMAND = "command"  # many to one, one way, at most once
    QUERY = "query"  # many to one, answered
    PUBLISH = "publish"  # one to many, one way


class Verb(StrEnum):
    """What a component does with an interface, in the words of CDSL."""

    REQUIRES = "requires"
    IMPLEMENTS = "implements"
    PUBLISHES = "publishes"
    SUBSCRIBES = "subscribesTo"

    @property
    def provides(self) -> bool:
        """Whether others find the channels of this port under our name."""
        return self in (Verb.IMPLEMENTS, Verb.PUBLISHES)

    @property
    def is_topic(self) -> bool:
        return self in (Verb.PUBLISHES, Verb.SUBSCRIBES)

    @property
    def has_proxy(self) -> bool:
        """Whether user code calls this port (a proxy), or is called by it (handlers)."""
        return self in (Verb.REQUIRES, Verb.PUBLISHES)


@dataclass(frozen=True)
class Operation(Generic[R]):
    """One operation of an interface. `R` is what it returns in Python.

    `outputs` holds the returned value first, named `ret`, then the `out` parameters in order.
    `pattern` is what the IDSL says, or None: then the operation is a query under
    requires/implements, and a publication under publishes/subscribesTo.
    """

    interface: str
    name: str
    inputs: tuple[Field, ...] = ()
    outputs: tuple[Field, ...] = ()
    raises: tuple[ExceptionType, ...] = ()
    pattern: Pattern | None = None
    idempotent: bool = False
    confirm: bool = field(default=False, compare=False, repr=False)
    """Whether a person is asked before it is called by hand: it stops or moves something."""
    doc: str = field(default="", compare=False, repr=False)
    source: str = field(default="", compare=False, repr=False)
    """Its declaration as the IDSL file spells it, for people."""

    def carried(self, verb: Verb) -> Pattern | None:
        """The pattern of this operation under that verb; None if the verb has no part in it.

        An operation that returns something cannot be a publication.
        """
        if self.pattern is None:
            if not verb.is_topic:
                return Pattern.QUERY
            return None if self.outputs or self.raises else Pattern.PUBLISH
        return self.pattern if (self.pattern is Pattern.PUBLISH) == verb.is_topic else None

    @cached_property
    def request(self) -> Struct:
        return Struct(self._message("Request"), self.inputs)

    @cached_property
    def response(self) -> Response:
        return Response(self._message("Response"), self.outputs)

    @cached_property
    def text(self) -> str:
        """Everything both sides must agree on, a line each; see `differences`."""
        return "\n".join(_describe(self))

    @cached_property
    def fingerprint(self) -> int:
        """The first 8 bytes of the SHA-256 of `text`, as an unsigned little-endian integer."""
        return int.from_bytes(hashlib.sha256(self.text.encode()).digest()[:8], "little")

    def _message(self, suffix: str) -> str:
        module, _, interface = self.interface.rpartition("::")
        words = "".join(word[:1].upper() + word[1:] for word in (*interface.split("_"), *re.split("[_-]", self.name)))
        return f"{module}::{words}{suffix}" if module else f"{words}{suffix}"


@dataclass(frozen=True)
class Interface:
    """A named set of operations, inherited ones included. `name` is qualified: `RoboCompLaser::Laser`."""

    name: str
    operations: tuple[Operation[Any], ...]
    doc: str = field(default="", compare=False, repr=False)
    actions: tuple[Action, ...] = ()

    @property
    def module(self) -> str:
        return self.name.rpartition("::")[0]

    @cached_property
    def short(self) -> str:
        return self.name.rpartition("::")[2]

    def under(self, verb: Verb) -> Iterator[tuple[Operation[Any], Pattern]]:
        """The operations that take part under a verb, each with the pattern it has there."""
        for operation in self.operations:
            pattern = operation.carried(verb)
            if pattern:
                yield operation, pattern

    def actions_under(self, verb: Verb) -> tuple[Action, ...]:
        """The actions that take part under a verb: all of them, unless it is that of a topic."""
        return () if verb.is_topic else self.actions

    def called(self, verb: Verb) -> list[str]:
        """The names of the operations and actions that take part under a verb, as settings know them."""
        return [operation.name for operation, _ in self.under(verb)] + [each.name for each in self.actions_under(verb)]

    def contracts(self, verb: Verb) -> Iterator[Operation[Any]]:
        """All that both sides must agree on: the operations that take part, and the parts of actions."""
        yield from (operation for operation, _ in self.under(verb))
        yield from (part for action in self.actions_under(verb) for part in action.parts)


def differences(ours: str, theirs: str) -> list[str]:
    """Where two canonical texts differ, as sentences: ours first."""
    mine, other = _sections(ours), _sections(theirs)
    found = []
    for name in dict.fromkeys([*mine, *other]):
        found += _compare(name, mine.get(name, _ABSENT), other.get(name, _ABSENT))
        if found and name == "operation":
            break  # of another module: every name differs
    return found or ["the order in which they are described"]


_Section = tuple[str, dict[str, str]]
"""What something is, and its members."""

_ABSENT: _Section = ("absent", {})


def _sections(text: str) -> dict[str, _Section]:
    """`struct X` and its `  field type` lines as {"X": ("struct", {"field": "type"})}."""
    sections: dict[str, _Section] = {}
    members: dict[str, str] = {}
    for line in text.splitlines():
        first, _, second = line.strip().partition(" ")
        if line.startswith("  "):
            members[first] = second
        else:
            members = {}
            name, what = (first, second) if first in ("operation", "pattern") else (second, first)
            sections[name] = (what, members)
    return sections


def _compare(name: str, mine: _Section, other: _Section) -> list[str]:
    (here, members), (there, others) = mine, other
    if here != there:
        return [f"{name}: {here} here, {there} there"]
    found = [
        f"{name}.{member}: {members.get(member, 'absent')} here, {others.get(member, 'absent')} there"
        for member in dict.fromkeys([*members, *others])
        if members.get(member) != others.get(member)
    ]
    if not found and list(members) != list(others):
        found = [f"{name}: {', '.join(members)} here, {', '.join(others)} there"]
    return found


def _describe(operation: Operation[R]) -> Iterator[str]:
    yield f"operation {operation.interface}.{operation.name}"
    yield f"pattern {operation.pattern or 'unspecified'}"
    messages = (operation.request, operation.response)
    for message in messages:
        yield from _members("struct", message.name, message.fields)
    exceptions = [(e.name, e.all_fields) for e in operation.raises]
    for name, fields in exceptions:
        yield from _members("exception", name, fields)
    named = [f.type for f in (*operation.inputs, *operation.outputs)]
    named += [f.type for _, fields in exceptions for f in fields]
    for kind in walk(*named):
        match kind:
            case Struct(name=name, fields=fields):
                yield from _members("struct", name, fields)
            case Enumeration(name=name, members=members):
                yield f"enum {name}"
                yield from (f"  {member} {value}" for member, value in members)


def _members(kind: str, name: str, fields: tuple[Field, ...]) -> Iterator[str]:
    yield f"{kind} {name}"
    for each in fields:
        yield f"  {each.name} {spell(each.type)}"
