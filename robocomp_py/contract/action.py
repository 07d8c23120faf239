"""Actions: operations that take long. Each is carried by three queries and two topics of patterns that exist.

    goTo-start      query    the inputs; answered with BUSY if the goal is not accepted
    goTo-result     query    the outputs and the declared exceptions; `NoResult` while there is none
    goTo-cancel     query    the state after that
    goTo-feedback   topic    best effort, depth 1; only if the action declares feedback
    goTo-status     topic    reliable and latched: the states of all goals that the server knows

A hyphen cannot be in a name of IDSL, so these names differ from all others, but not in Ice, which has `_` instead.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from functools import cached_property
from typing import Any

from ..errors import DeclaredError
from .component import Port
from .interface import Interface, Operation, Pattern, Verb
from .qos import Durability, QoS, Reliability
from .types import BOOL, FLOAT32, INT8, UINT8, ExceptionType, Field, Sequence, Struct

OCTETS = 16
"""The length of the id of a goal."""

FEEDBACK_QOS = QoS(reliability=Reliability.BEST_EFFORT, depth=1)
STATUS_QOS = QoS(reliability=Reliability.RELIABLE, durability=Durability.TRANSIENT_LOCAL, depth=1)

PARTS = ("start", "result", "cancel", "feedback", "status")
"""What is behind the hyphen in the names of the parts."""

RESERVED = frozenset({"goal", "detached"})
"""Names of parameters that an action adds itself."""


class GoalState(IntEnum):
    """The state of a goal. The numbers are those of `action_msgs/GoalStatus` in ROS 2."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @property
    def is_over(self) -> bool:
        return self >= GoalState.SUCCEEDED


class Policy(StrEnum):
    """What a server does with a goal that arrives while another one of the same action is active."""

    REFUSE = "refuse"
    PREEMPT = "preempt"
    QUEUE = "queue"


POLICIES = tuple(map(str, Policy))


@dataclass(eq=False)
class NoResult(DeclaredError):
    """There is no result: `state` tells why. The client sees this exception as what it means."""

    state: int = 0


NO_RESULT = ExceptionType("Actions::NoResult", (Field("state", INT8),), python=NoResult)
NoResult.__contract__ = NO_RESULT  # type: ignore[attr-defined]  # as generated exceptions have it

_GOAL = Field("goal", Sequence(UINT8))


@dataclass(frozen=True)
class Action:
    """One action of an interface. The fields are those of `Operation`."""

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
        inputs = (_GOAL, Field("detached", BOOL), *self.inputs)
        name, doc = f"{self.name}-start", self.doc
        return Operation(self.interface, name, inputs, (), (), Pattern.QUERY, confirm=self.confirm, doc=doc)

    @cached_property
    def result(self) -> Operation[Any]:
        inputs = (_GOAL, Field("wait", FLOAT32))
        raises = (*self.raises, NO_RESULT)
        return Operation(self.interface, f"{self.name}-result", inputs, self.outputs, raises, Pattern.QUERY)

    @cached_property
    def cancel(self) -> Operation[int]:
        outputs = (Field("ret", INT8),)
        return Operation(self.interface, f"{self.name}-cancel", (_GOAL,), outputs, (), Pattern.QUERY, idempotent=True)

    @cached_property
    def told(self) -> Operation[None] | None:
        """The topic of its feedback."""
        if self.feedback is None:
            return None
        inputs = (_GOAL, Field("feedback", self.feedback))
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
        """Everything both sides must agree on; see `interface.differences`."""
        return "\n".join(part.text for part in self.parts)

    def inherited(self, interface: str) -> Action:
        """This action in an interface that extends its own."""
        return replace(self, interface=interface, origin=self.origin or self.interface)


def calls_of(interface: Interface) -> Interface:
    """The queries of all actions of an interface."""
    return Interface(interface.name, tuple(each for action in interface.actions for each in action.queries))


def topics_of(interface: Interface) -> Interface:
    """The topics of all actions of an interface."""
    return Interface(interface.name, tuple(each for action in interface.actions for each in action.topics))


def qos_of(operation: Operation[Any]) -> QoS:
    """The QoS of such a topic."""
    return FEEDBACK_QOS if operation.name.endswith("-feedback") else STATUS_QOS


def ports_of_actions(port: Port) -> list[Port]:
    """Ports for the parts of its actions, as if they were operations: for its queries, and for each of its topics."""
    if not port.interface.actions_under(port.verb):
        return []
    verb = Verb.PUBLISHES if port.verb.provides else Verb.SUBSCRIBES
    topics = topics_of(port.interface).operations
    found = [replace(port, interface=calls_of(port.interface))]
    for each in topics:
        found.append(replace(port, verb=verb, interface=Interface(port.interface.name, (each,)), qos=qos_of(each)))
    return found
