"""What both sides hold of a goal, and the bounds of both."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Generator
from concurrent.futures import Future, InvalidStateError
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

from ..contract.goal import GoalState
from ..errors import Closed, Timeout
from ..threads import only_wakes_a_loop

R = TypeVar("R")
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


Run = Callable[[Callable[[], object]], object]
"""Runs a callback, as a handler of the component if there is one."""


class Goal(Generic[R_co, F_co]):
    """A goal of an action, at its client. May be used from any thread.

    `await goal` is its result in asyncio code. Handlers wait if that code holds the worker, as in `compute`.
    """

    def __init__(
        self, name: str, identity: bytes, awaiting: Awaiting, cancel: Callable[[Goal[Any, Any]], object], run: Run
    ) -> None:
        self.id = identity
        """16 octets, which no other goal has."""
        self._name, self._awaiting, self._cancel, self._run = name, awaiting, cancel, run
        self._feedback: F_co | None = None
        self._status = GoalState.UNKNOWN
        self._value: Any = None
        self._error: Exception | None = None
        self._is_done = False
        self._lock = threading.Lock()
        self._pending: set[Future[Any]] = set()
        """Done when the goal is over."""

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
        return self.future().result(timeout)

    def future(self) -> Future[R_co]:
        """A Future that is done when the goal is over. Its `result` is that of the goal.

        Its callbacks run like handlers: one at a time, never concurrently with other code of the worker. To cancel it
        does not cancel the goal.
        """
        return self._follow(GoalFuture(self))

    def __await__(self) -> Generator[Any, None, R_co]:
        """Wait for the end of the goal, and return its result, in asyncio code.

        Raises what `result` raises. If the task that waits is cancelled, the goal is not.
        """
        import asyncio  # which few components use

        followed: Future[R_co] = self._follow(Future())  # its callbacks wait for no other code of the worker
        return asyncio.wrap_future(followed).__await__()

    def __repr__(self) -> str:
        return f"<goal {self.id.hex()[:8]} of {self._name}: {self._status.name}>"

    def _follow(self, future: Future[R]) -> Future[R]:
        """Let a Future end with the goal."""
        with self._lock:
            if not self._is_done:
                self._pending.add(future)
                Future.add_done_callback(future, self._forget)
                return future
        self._settle(future)
        return future

    def _forget(self, future: Future[Any]) -> None:
        with self._lock:
            self._pending.discard(future)
        if future.cancelled():
            future.set_running_or_notify_cancel()  # for `concurrent.futures.wait`

    def _settle(self, future: Future[Any]) -> None:
        with contextlib.suppress(InvalidStateError):  # it was cancelled meanwhile
            if self._error is None:
                future.set_result(self._value)
            else:
                future.set_exception(self._error)

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
            pending = list(self._pending)
        for each in pending:
            self._settle(each)

    def _turn_away(self) -> None:
        """End all that waits for the goal, because the component is asked to stop."""
        with self._lock:
            pending = list(self._pending)
        for each in pending:
            with contextlib.suppress(InvalidStateError):
                each.set_exception(self._closed())

    def _closed(self) -> Closed:
        return Closed(f"{self._name}: the component is stopping")


class GoalFuture(Future[R]):
    """The end of a goal. While the worker waits for it, other handlers may run."""

    def __init__(self, goal: Goal[R, Any]) -> None:
        super().__init__()
        self._goal = goal

    def result(self, timeout: float | None = None) -> R:
        """The result of the goal, or the exception that it ended with.

        Raises Timeout if the goal is not over after `timeout` seconds, and Closed if the component stops.
        """
        self._wait(timeout)
        return super().result(0)

    def exception(self, timeout: float | None = None) -> BaseException | None:
        """The exception that the goal ended with; None if it has a result. Raises Timeout and Closed, as `result`."""
        self._wait(timeout)
        return super().exception(0)

    def add_done_callback(self, fn: Callable[[Future[R]], object]) -> None:
        """Call a function with this future once the goal is over, as a handler of the component.

        `asyncio.wrap_future` does not wait for other code of the worker.
        """
        if only_wakes_a_loop(fn):
            super().add_done_callback(fn)
        else:
            super().add_done_callback(lambda _: self._goal._run(partial(fn, self)))

    def _wait(self, timeout: float | None) -> None:
        if self.done():
            return
        wake, goal = threading.Event(), self._goal
        waiting = [wake]

        def over(_: object) -> None:
            for each in waiting:
                each.set()

        super().add_done_callback(over)
        try:
            goes_on = goal._awaiting(timeout, self.done, wake)
        finally:
            waiting.clear()  # a clock in lock-step counts a thread as working as long as its event exists
        if not self.done():
            late = "" if timeout is None else f" after {timeout:g} s"
            raise Timeout(f"{goal._name}: the goal is not over{late}") if goes_on else goal._closed()


_STATES = frozenset(map(int, GoalState))


class ServerGoal:
    """A goal of an action, at its server: the first argument of the handler."""

    def __init__(self, identity: bytes, tell: Callable[[Any], object]) -> None:
        self.id = identity
        """16 octets, which no other goal has."""
        self._tell = tell
