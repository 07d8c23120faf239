"""What both sides hold of a goal, and the bounds of both."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from ..contract.action import GoalState
from ..errors import Closed, Timeout

R_co = TypeVar("R_co", covariant=True)
F_co = TypeVar("F_co", covariant=True)

MOST_GOALS = 128
"""Maximum number of goals of one proxy that are not over; a further one raises Busy."""

MOST_QUEUED = 100
"""Maximum number of goals that wait at a server with the policy `queue`; further ones are refused."""

MOST_RESULTS = 100
"""Maximum number of results that a server keeps."""

MOST_POLLS = 4
"""Maximum number of requests for the result of one goal that wait at a server; a further one ends the oldest."""


@dataclass(frozen=True)
class Times:
    """Seconds of the machine's clock, or of virtual time."""

    slice: float = 1.5
    """A client asks for the result again after this time, which also shows that it is there."""
    reply: float = 1.0
    """How much longer it waits for an answer."""
    silence: float = 5.0
    """A server cancels the goals of a client that has not asked for this time; also the longest slice."""
    kept: float = 60.0
    """A server keeps a result for this time."""


Awaiting = Callable[[float | None, Callable[[], bool], threading.Event], bool]
"""Waits for a number of seconds on the component's clock, or until a condition holds, which is looked at whenever the
event is set. Meanwhile handlers may run. Returns False if the component is stopping."""


class Goal(Generic[R_co, F_co]):
    """A goal of an action, at its client. May be used from any thread."""

    def __init__(
        self, name: str, identity: bytes, awaiting: Awaiting, cancel: Callable[[Goal[Any, Any]], object]
    ) -> None:
        self.id = identity
        """16 octets, which no other goal has."""
        self._name, self._awaiting, self._cancel = name, awaiting, cancel
        self._feedback: F_co | None = None
        self._status = GoalState.UNKNOWN
        self._value: Any = None
        self._error: Exception | None = None
        self._is_done = False
        self._lock = threading.Lock()
        self._waiting: list[threading.Event] = []

    @property
    def feedback(self) -> F_co | None:
        """The newest feedback; None if none has come yet. Older feedback may be lost."""
        return self._feedback

    @property
    def status(self) -> GoalState:
        """The last state that this client has learned."""
        return self._status

    @property
    def done(self) -> bool:
        """Whether `result` returns or raises at once."""
        return self._is_done

    def cancel(self) -> None:
        """Ask the server to cancel the goal. Its handler decides what then happens; `result` tells.

        Without effect if the goal is over. Raises TransportErrors, as calls do.
        """
        if not self._is_done:
            self._cancel(self)

    def result(self, timeout: float | None = None) -> R_co:
        """Wait for the end of the goal, and return its result. Meanwhile handlers may run, as during a call.

        Raises the exceptions that the action declares, Cancelled, RemoteFailure for any other exception of its
        handler, Unreachable if the server goes, Timeout if the goal is not over after `timeout` seconds of the
        component's clock, and Closed if this component is asked to stop. May be called again.
        """
        if not self._is_done:
            self._wait(timeout)
        if self._error is not None:
            raise self._error
        value: R_co = self._value
        return value

    def __repr__(self) -> str:
        return f"<goal {self.id.hex()[:8]} of {self._name}: {self._status.name}>"

    def _wait(self, timeout: float | None) -> None:
        wake = threading.Event()
        with self._lock:
            if self._is_done:
                return
            self._waiting.append(wake)
        try:
            goes_on = self._awaiting(timeout, lambda: self._is_done, wake)
        finally:
            with self._lock:
                self._waiting.remove(wake)
        if not self._is_done:
            if not goes_on:
                raise Closed(f"{self._name}: the component is stopping")
            raise Timeout(f"{self._name}: the goal is not over after {timeout:g} s")

    # For the client that it belongs to.

    def _note(self, state: int) -> None:
        """Note a state that the server tells. What comes late changes nothing."""
        with self._lock:
            if not self._is_done and state > self._status and state in _STATES:
                self._status = GoalState(state)

    def _end(self, state: GoalState, value: Any = None, error: Exception | None = None) -> None:
        with self._lock:
            if self._is_done:
                return
            self._status = state or self._status
            self._value, self._error, self._is_done = value, error, True
            waiting = list(self._waiting)
        for each in waiting:
            each.set()


_STATES = frozenset(map(int, GoalState))


class ServerGoal:
    """A goal of an action, at its server: the first argument of the handler."""

    def __init__(self, identity: bytes, tell: Callable[[Any], object]) -> None:
        self.id = identity
        """16 octets, which no other goal has."""
        self._tell = tell
