"""Begins goals, and learns how they end.

For each goal that is not over, one request for its result is under way. That request shows the server that the client
is there, and it fails when the server goes.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, wait
from functools import partial
from typing import Any, TypeVar

from ..contract.goal import OCTETS, GoalState, NoResult
from ..contract.interface import Action, Operation
from ..errors import Busy, Cancelled, RemoteFailure, RobocompError, Timeout, TransportError, Unreachable
from ..runtime.ports import Proxy
from ..transports.base import about_to_block
from .goal import MOST_GOALS, Awaiting, Goal, Run, Times

log = logging.getLogger("robocomp.worker")

R = TypeVar("R")
F = TypeVar("F")

_LEAVING = 0.5
"""Seconds within which each goal is cancelled when the client closes."""

_HELD = 1.0
"""Longest time in seconds that the end of a goal is not counted as handled while its result is under way."""


class GoalClient:
    """The goals of one port."""

    def __init__(
        self,
        actions: tuple[Action, ...],
        bound: Mapping[str, Any],
        awaiting: Awaiting,
        identity: Callable[[], bytes],
        times: Times = Times(),  # noqa: B008 - frozen
        *,
        run: Run = lambda callback: callback(),
        holds: bool = False,
    ) -> None:
        """`bound` are the queries of the actions; `run` runs callbacks of the futures of goals. If it `holds`, a
        message by which a goal ends is handled when its result is here, so that a clock in lock-step waits for it."""
        self._actions = {each.name: each for each in actions}
        self._bound, self._awaiting, self._identity, self._times = bound, awaiting, identity, times
        self._run, self._holds = run, holds
        self._goals: dict[bytes, tuple[Action, Goal[Any, Any], bool]] = {}
        self._lock = threading.Lock()
        self._is_closed = False

    def wrap_queries(self, wrap: Callable[[Any], Any]) -> None:
        """Call the queries of the actions through what `wrap` makes of each."""
        self._bound = {name: wrap(each) for name, each in self._bound.items()}

    def begin(
        self, action: Action, arguments: tuple[Any, ...], detached: bool, deadline: float | None
    ) -> Goal[Any, Any]:
        """Begin a goal, and wait until its server has accepted it. Raises what calls raise."""
        name = f"{action.interface}.{action.name}".replace("::", ".")
        goal: Goal[Any, Any] = Goal(name, self._identity(), self._awaiting, partial(self._cancel, action), self._run)
        with self._lock:
            if len(self._goals) >= MOST_GOALS:
                raise Busy(f"{name}: {MOST_GOALS} goals of this component are not over")
            self._goals[goal.id] = action, goal, detached
        try:
            self._ask(action, action.start, (goal.id, detached, *arguments), deadline)
        except BaseException as exc:
            self._forget(goal)
            if isinstance(exc, Busy):
                raise Busy(f"{name}: its server does not accept the goal now: another one is active") from exc
            raise
        goal._note(GoalState.ACCEPTED)
        self._poll(action, goal)
        return goal

    def heard(self, goal: Any, feedback: Any) -> None:
        """Take feedback of any goal of that server."""
        known = self._goals.get(bytes(goal))
        if known:
            known[1]._feedback = feedback

    def told(self, goals: Any, states: Any) -> None:
        """Take the states of all goals of that server."""
        octets, numbers = bytes(goals), bytes(states)
        for number, state in enumerate(numbers):
            known = self._goals.get(octets[number * OCTETS : (number + 1) * OCTETS])
            if known:
                known[1]._note(state)
                if self._holds and state >= GoalState.SUCCEEDED:
                    _hold(known[1])

    def turn_away(self) -> None:
        """End what waits for goals now, because the component is asked to stop. The goals go on until `close`."""
        for _, goal, _ in self._left():
            goal._turn_away()

    def close(self) -> None:
        """Cancel the goals that are not detached, and end all of them here. No goal can begin from now on."""
        self._is_closed = True
        left = self._left()
        self._cancel_all((action, goal) for action, goal, detached in left if not detached)
        for _, goal, _ in left:
            self._end(goal, GoalState.UNKNOWN, error=goal._closed())

    def _left(self) -> list[tuple[Action, Goal[Any, Any], bool]]:
        with self._lock:
            return list(self._goals.values())

    def _cancel_all(self, goals: Iterable[tuple[Action, Goal[Any, Any]]]) -> None:
        for action, goal in goals:
            try:
                self._bound[action.cancel.name].ask((goal.id,), _LEAVING)
            except RobocompError as exc:  # its server notices the silence
                log.debug("%r was not cancelled: %s", goal, exc)
                return

    def _ask(self, action: Action, part: Operation[Any], arguments: tuple[Any, ...], deadline: float | None) -> Any:
        try:
            return self._bound[part.name].ask(arguments, deadline)
        except RobocompError as exc:
            _name_action(exc, action, part)
            raise

    def _cancel(self, action: Action, goal: Goal[Any, Any]) -> None:
        goal._note(self._ask(action, action.cancel, (goal.id,), None))

    def _poll(self, action: Action, goal: Goal[Any, Any]) -> None:
        times = self._times
        arguments = goal.id, times.slice
        try:
            answer: Future[Any] = self._bound[action.result.name].ask_async(arguments, times.slice + times.reply)
        except RobocompError as exc:
            _name_action(exc, action, action.result)
            self._end(goal, GoalState.UNKNOWN, error=exc)
            return
        Future.add_done_callback(answer, partial(self._answered, action, goal))  # outside of the monitor

    def _answered(self, action: Action, goal: Goal[Any, Any], answer: Future[Any]) -> None:
        if answer.cancelled():
            return
        error = answer.exception(0)
        if isinstance(error, TransportError | RemoteFailure):
            _name_action(error, action, action.result)
        match error:
            case None:
                self._end(goal, GoalState.SUCCEEDED, answer.result(0))
            case NoResult(state=GoalState.UNKNOWN):
                lost = Unreachable(f"{goal._name}: its server was started again, and does not know the goal")
                self._end(goal, GoalState.UNKNOWN, error=lost)
            case NoResult(state=GoalState.CANCELED):
                self._end(goal, GoalState.CANCELED, error=Cancelled(f"{goal._name}: the goal was cancelled"))
            case NoResult(state=state):
                goal._note(state)
                self._go_on(action, goal)
            case Timeout():
                self._go_on(action, goal)
            case TransportError():
                self._end(goal, GoalState.UNKNOWN, error=error)
            case Exception():
                self._end(goal, GoalState.ABORTED, error=error)
            case _:
                raise error

    def _go_on(self, action: Action, goal: Goal[Any, Any]) -> None:
        if self._is_closed:
            self._end(goal, GoalState.UNKNOWN, error=goal._closed())
        else:
            self._poll(action, goal)

    def _end(self, goal: Goal[Any, Any], state: GoalState, value: Any = None, error: Exception | None = None) -> None:
        self._forget(goal)
        goal._end(state, value, error)

    def _forget(self, goal: Goal[Any, Any]) -> None:
        with self._lock, contextlib.suppress(KeyError):
            del self._goals[goal.id]


def _name_action(error: RobocompError, action: Action, part: Operation[Any]) -> None:
    """Let an error name the action, and not the part of it that was asked."""
    error.args = tuple(each.replace(part.name, action.name) if isinstance(each, str) else each for each in error.args)
    if isinstance(error, RemoteFailure):
        error.operation = error.operation.replace(part.name, action.name)


def _hold(goal: Goal[Any, Any]) -> None:
    """Wait until a goal is done, but not long."""
    about_to_block()  # the result comes by the threads that receive
    wait([goal._follow(Future())], _HELD)


class ActionProxy(Proxy):
    """Base of the generated proxies of interfaces with actions."""

    _goals: GoalClient

    def _begin(
        self, action: Action, arguments: tuple[Any, ...], detached: bool, deadline: float | None
    ) -> Goal[Any, Any]:
        return self._goals.begin(action, arguments, detached, deadline)
