"""The other sides of actions in a test: fakes that execute goals, and a client that begins them."""

from __future__ import annotations

import contextlib
import inspect
import threading
import time
from collections.abc import Callable, Generator
from functools import partial
from types import SimpleNamespace
from typing import Any

from ..actions.binding import Connected, Surroundings, connect, new_identity, serve
from ..actions.client import ActionProxy, GoalClient
from ..actions.goal import Goal, ServerGoal
from ..actions.server import GoalServer
from ..contract.component import Port
from ..contract.interface import Action, Operation
from ..errors import Closed, TransportError
from ..runtime.calls import Outcome
from ..runtime.clock import SECOND
from ..runtime.monitor import Monitor
from ..runtime.route import Route
from ..transports.base import Link, Reply, Status
from .fakes import Late, chosen
from .patience import SOON
from .stages import Raised, RealTime, VirtualTime

_BEAT = 0.01
"""Seconds between two steps of a fake."""

Act = Callable[[Port, Action, tuple[Any, ...]], Any]
"""What the fake of an action does with a goal of these arguments; it is noted as received."""


class GoalsOfTest:
    """What faces the actions of a component under test."""

    def __init__(
        self, stage: RealTime | VirtualTime, monitor: Monitor, route: Callable[[Port, Operation[Any]], Route], act: Act
    ) -> None:
        self._stage, self._route, self._act = stage, route, act
        self._around = Surroundings(monitor, self._await, time.monotonic, new_identity)
        self._clients: dict[str, GoalClient] = {}
        self._fakes: list[GoalServer] = []

    def face(self, port: Port, facing: Port) -> list[Link]:
        """Make the other side of a port's actions; returns its links."""
        connected = Connected()
        if port.verb.has_proxy:
            handlers = {facing.handler(each.name): partial(self._steps, port, each) for each in port.interface.actions}
            policies = tuple((each.name, "queue") for each in port.interface.actions)
            facing = Port(facing.verb, facing.interface, facing.number, policies=policies)
            servers = serve(facing, SimpleNamespace(**handlers), self._way, self._around, connected)
            if not self._fakes:
                self._stage.every(_BEAT, self._step)
            self._fakes += servers
        else:
            client = connect(facing, ActionProxy({}), self._way, self._around, connected)
            client._bound = {name: _Outside(self._stage, each) for name, each in client._bound.items()}
            self._clients[port.name] = client
        return connected.links

    def begin(self, port: str, action: Action, arguments: tuple[Any, ...], deadline: float) -> Goal[Any, Any]:
        return self._clients[port].begin(action, arguments, False, deadline)

    def _way(self, port: Port, operation: Operation[Any], action: str) -> Route:
        return self._route(port, operation)

    def _await(self, seconds: float | None, condition: Callable[[], bool], wake: threading.Event) -> bool:
        with contextlib.suppress(AssertionError):  # the time is over
            self._stage.wait(condition, SOON if seconds is None else seconds)
        return not self._stage.running.is_over

    def _step(self) -> None:
        if any(each.active for each in self._fakes):
            with contextlib.suppress(Closed), self._around.monitor.held():
                for each in self._fakes:
                    each.step()

    def _steps(self, port: Port, action: Action, goal: ServerGoal, *arguments: Any) -> Generator[None, None, Any]:
        answer = self._act(port, action, arguments)
        if isinstance(answer, Late):
            clock = self._stage.running.clock
            end = clock.now() + answer.seconds * SECOND
            while clock.now() < end:
                yield
            answer = chosen(answer.answer)
        if inspect.isgeneratorfunction(answer):
            return (yield from answer(goal, *arguments))
        if isinstance(answer, TransportError):
            raise Outcome(Reply(Status.FAILED, Raised(answer)))
        if isinstance(answer, BaseException):
            raise answer
        return answer(*arguments) if callable(answer) else answer


class _Outside:
    """A call of the component, from outside of it."""

    def __init__(self, stage: RealTime | VirtualTime, bound: Any) -> None:
        self._stage, self._bound = stage, bound
        self.ask_async = bound.ask_async

    def ask(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        return self._stage.do(partial(self._bound.ask, arguments, deadline))
