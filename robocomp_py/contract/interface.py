"""Interfaces, their operations and actions, and the fingerprint by which two sides know they mean the same."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import Any, Generic, TypeVar

from .goal import GOAL, NO_RESULT
from .qos import Durability, QoS, Reliability
from .types import (
    BOOL,
    FLOAT32,
    INT8,
    UINT8,
    Enumeration,
    ExceptionType,
    Field,
    Response,
    Sequence,
    Struct,
    spell,
    walk,
)

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
    def called(self) -> str:
        """Its name for people, `RoboCompArm.Arm.move`; of a part of an action, the name of the action."""
        return f"{self.interface}.{self.name.partition('-')[0]}".replace("::", ".")

    @cached_property
    def request(self) -> Struct:
        return Struct(self._message("Request"), self.inputs, called=self.called)

    @cached_property
    def response(self) -> Response:
        return Response(self._message("Response"), self.outputs, called=self.called)

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


PARTS = ("start", "result", "cancel", "feedback", "status")
"""What is behind the hyphen in the names of the parts of an action."""

RESERVED = frozenset({"goal", "detached"})
"""Names of parameters that an action adds itself."""

FEEDBACK_QOS = QoS(reliability=Reliability.BEST_EFFORT, depth=1)
STATUS_QOS = QoS(reliability=Reliability.RELIABLE, durability=Durability.TRANSIENT_LOCAL, depth=1)


@dataclass(frozen=True)
class Action:
    """An operation that takes long. The fields are those of `Operation`. Three queries and two topics carry it:

        goTo-start      query    the inputs; answered with BUSY if the goal is not accepted
        goTo-result     query    the outputs and the declared exceptions; `NoResult` while there is none
        goTo-cancel     query    the state after that
        goTo-feedback   topic    best effort, depth 1; only if the action declares feedback
        goTo-status     topic    reliable and latched: the states of all goals that the server knows

    A hyphen cannot be in a name of IDSL, so these names differ from all others, but not in Ice, which has `_` instead.
    """

    interface: str
    name: str
    inputs: tuple[Field, ...] = ()
    outputs: tuple[Field, ...] = ()
    feedback: Struct | None = None
    """What its server tells from time to time; its name ends in `Feedback`."""
    raises: tuple[ExceptionType, ...] = ()
    origin: str = ""
    """The interface that declares it, if it is inherited; "" if that is its own."""
    confirm: bool = field(default=False, compare=False, repr=False)
    """Whether a person is asked before a goal is sent by hand."""
    goal: type[Any] | None = field(default=None, compare=False, repr=False)
    """The generated class of what its handler gets of a goal, if it declares feedback."""
    doc: str = field(default="", compare=False, repr=False)
    source: str = field(default="", compare=False, repr=False)
    """Its declaration as the IDSL file spells it, for people."""

    @cached_property
    def start(self) -> Operation[None]:
        inputs = (GOAL, Field("detached", BOOL), *self.inputs)
        name, doc = f"{self.name}-start", self.doc
        return Operation(self.interface, name, inputs, (), (), Pattern.QUERY, confirm=self.confirm, doc=doc)

    @cached_property
    def result(self) -> Operation[Any]:
        inputs = (GOAL, Field("wait", FLOAT32))
        raises = (*self.raises, NO_RESULT)
        return Operation(self.interface, f"{self.name}-result", inputs, self.outputs, raises, Pattern.QUERY)

    @cached_property
    def cancel(self) -> Operation[int]:
        outputs = (Field("ret", INT8),)
        return Operation(self.interface, f"{self.name}-cancel", (GOAL,), outputs, (), Pattern.QUERY, idempotent=True)

    @cached_property
    def told(self) -> Operation[None] | None:
        """The topic of its feedback."""
        if self.feedback is None:
            return None
        inputs = (GOAL, Field("feedback", self.feedback))
        return Operation(self.interface, f"{self.name}-feedback", inputs, (), (), Pattern.PUBLISH)

    @cached_property
    def status(self) -> Operation[None]:
        inputs = (Field("goals", Sequence(UINT8)), Field("states", Sequence(UINT8)))
        return Operation(self.interface, f"{self.name}-status", inputs, (), (), Pattern.PUBLISH)

    @property
    def queries(self) -> tuple[Operation[Any], ...]:
        return self.start, self.result, self.cancel

    @property
    def topics(self) -> tuple[Operation[None], ...]:
        return (self.told, self.status) if self.told else (self.status,)

    @property
    def parts(self) -> tuple[Operation[Any], ...]:
        return *self.queries, *self.topics

    @cached_property
    def text(self) -> str:
        """Everything both sides must agree on; see `differences`."""
        return "\n".join(part.text for part in self.parts)

    def inherited(self, interface: str) -> Action:
        """This action in an interface that extends its own."""
        return replace(self, interface=interface, origin=self.origin or self.interface)


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


def calls_of(interface: Interface) -> Interface:
    """The queries of all actions of an interface."""
    return Interface(interface.name, tuple(each for action in interface.actions for each in action.queries))


def topics_of(interface: Interface) -> Interface:
    """The topics of all actions of an interface."""
    return Interface(interface.name, tuple(each for action in interface.actions for each in action.topics))


def qos_of(operation: Operation[Any]) -> QoS:
    """The QoS of such a topic."""
    return FEEDBACK_QOS if operation.name.endswith("-feedback") else STATUS_QOS


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
