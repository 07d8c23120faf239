"""Goals of actions: their states, and what a server does with one that arrives while another one is active."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum

from ..errors import DeclaredError
from .types import INT8, UINT8, ExceptionType, Field, Sequence

OCTETS = 16
"""The length of the id of a goal."""


class GoalState(IntEnum):
    """The state of a goal. The numbers are those of `action_msgs/GoalStatus` in ROS 2; `str` is the name."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    def __str__(self) -> str:
        return self.name

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

GOAL = Field("goal", Sequence(UINT8))
"""The parameter that has the id of a goal."""
