"""What a fake does when the component under test calls it.

    store=7                                     a value: it is the answer
    store=lambda data: len(data)                a function of the operation's arguments
    store=Full("no room")                       an exception that the operation declares, or any other one
    store=Unreachable("gone")                   what a middleware raises: `Unreachable`, `Timeout`, `Busy`, `Refused`
    store=late(2.0, 7)                          the answer comes after two seconds
    store=in_turn(1, 2, Busy("full"), 3)        one after the other; the last one repeats
    store=gone_after(3, 7)                      three answers, then `Unreachable`

They may be nested: `in_turn(late(1.0, 7), Unreachable("gone"))`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias, TypeVar

from ..errors import TransportError, Unreachable

__all__ = ["Fake", "InTurn", "Late", "gone_after", "in_turn", "late"]

R = TypeVar("R")


@dataclass(frozen=True)
class Late(Generic[R]):
    """An answer that comes after a number of seconds."""

    seconds: float
    answer: Any


class InTurn(Generic[R]):
    """Answers to one call after the other. The last one repeats."""

    def __init__(self, answers: tuple[Any, ...]) -> None:
        if not answers:
            raise ValueError("in_turn: give one answer at least")
        self.answers, self._next, self._lock = answers, 0, threading.Lock()

    def take(self) -> Any:
        """The answer to the present call."""
        with self._lock:
            answer = self.answers[self._next]
            self._next = min(self._next + 1, len(self.answers) - 1)
            return answer


Fake: TypeAlias = R | BaseException | Callable[..., R] | Late[R] | InTurn[R]
"""What may be given for an operation that returns R."""


def late(seconds: float, answer: R | BaseException | Callable[..., R]) -> Late[R]:
    """An answer after a number of seconds. A call whose deadline is earlier ends as `Timeout`, at its deadline."""
    return Late(seconds, answer)


def in_turn(*answers: R | BaseException | Callable[..., R] | Late[R]) -> InTurn[R]:
    """The answer of the first call, of the second one, and so on; all further calls get the last one."""
    return InTurn(answers)


def gone_after(calls: int, answer: R | BaseException | Callable[..., R]) -> InTurn[R]:
    """The first `calls` calls get this answer; all further ones end as `Unreachable`, as if the server had ended."""
    return InTurn((*[answer] * calls, Unreachable("the fake is gone")))


def chosen(fake: Any) -> Any:
    """What a fake does in the present call: a value, an exception, a function or a `Late`."""
    while isinstance(fake, InTurn):
        fake = fake.take()
    return fake


def is_late(fake: Any) -> bool:
    """Whether it may answer late."""
    return isinstance(fake, Late) or (isinstance(fake, InTurn) and any(map(is_late, fake.answers)))


def hinders(answer: Any) -> TransportError | None:
    """The error, if any, because of which a message cannot be sent."""
    return answer if isinstance(answer, TransportError) else None
