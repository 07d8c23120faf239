"""Calls of a test into a simulated network: queries, commands, and goals of actions."""

from __future__ import annotations

import hashlib
import itertools
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple

from ..actions.binding import Connected, Surroundings, connect
from ..actions.client import ActionProxy, GoalClient
from ..actions.goal import Goal
from ..client.arguments import arguments
from ..contract.component import Port
from ..contract.interface import Action, Operation, Verb
from ..errors import ComponentError
from ..runtime import ports
from ..runtime.lifecycle import State
from ..runtime.monitor import Monitor, Threads
from ..runtime.route import Route
from ..runtime.settings import DEADLINE
from ..spelling import unknown
from ..transports.base import Link, Transport
from ..virtual.outside import provided
from ..virtual.simulation import Part, Simulation
from ..wire import names

NAME = "test"
"""The instance name of the test, as components see it."""

PATIENCE = 60.0
"""Virtual seconds that a network may take to start, and a goal without a timeout to end."""

_STARTING = (State.STARTING, State.INITIALIZE)


class Calls:
    """What a test calls in a simulated network. Links open when they are first used, on the thread of the test."""

    def __init__(
        self, simulation: Simulation, parts: Sequence[Part], threads: Threads, opened: Callable[[str, str], Transport]
    ) -> None:
        """`opened` opens the transport of a name that stands in for a middleware."""
        self._simulation, self._opened = simulation, opened
        self._components = [simulation[each.instance] for each in parts]
        self._operations = provided(parts)
        self._actions = {name: each for part in parts for name, each in _actions(part)}
        self._outside = simulation.outside(NAME)
        self._asks: dict[str, Callable[..., Any]] = {}
        self._clients: dict[Port, GoalClient] = {}
        self._links: list[Link] = []
        self._transports: list[Transport] = []
        self._monitor = Monitor(NAME, threads)
        self._monitor.open()
        self._numbers = itertools.count(1)

    def call(self, name: str, values: Sequence[Any], named: dict[str, Any]) -> Any:
        """See `Simulation.call`."""
        if any(each.state in _STARTING for each in self._components):
            self._simulation.run(until=self._have_started, at_most=PATIENCE)
        if name in self._actions:
            return self._begin(name, self._actions[name], values, named)
        if name not in self._operations:
            raise KeyError(unknown("operation", name, [*self._operations, *self._actions]))
        if name not in self._asks:
            self._asks[name] = self._outside.asks(name)
        given = arguments(name, self._operations[name].operation.inputs, values, named)
        return self._simulation.do(lambda: self._asks[name](*given))

    def close(self, *, cancel: bool) -> None:
        """Close all links; with `cancel`, goals that are not over are cancelled before."""
        for each in self._clients.values() if cancel else ():
            each.close()
        ports.close_all(self._links)
        self._monitor.close()
        for transport in self._transports:
            transport.close()
        self._outside.close()

    def _have_started(self) -> bool:
        return not any(each.state in _STARTING for each in self._components)

    def _begin(self, name: str, offered: _Offered, values: Sequence[Any], named: dict[str, Any]) -> Goal[Any, Any]:
        given = arguments(name, offered.action.inputs, values, named)
        if offered.port not in self._clients:
            self._clients[offered.port] = self._connected(offered)
        return self._clients[offered.port].begin(offered.action, given, False, None)

    def _connected(self, offered: _Offered) -> GoalClient:
        transport = self._opened(NAME, offered.middleware)
        self._transports.append(transport)
        around = Surroundings(self._monitor, self._await, lambda: self._simulation.time, self._identity)
        connected = Connected()

        def way(port: Port, operation: Operation[Any], action: str) -> Route:
            channel = f"{offered.place}/{operation.name}"
            return Route(transport, offered.middleware, channel, port.qos, DEADLINE)

        client = connect(Port(Verb.REQUIRES, offered.port.interface), ActionProxy({}), way, around, connected)
        client.wrap_queries(self._in_the_network)
        self._links += connected.links
        return client

    def _in_the_network(self, bound: Any) -> Any:
        """Makes each call an event of the network, because the test itself runs outside of its events."""

        def ask(arguments: tuple[Any, ...], deadline: float | None) -> Any:
            return self._simulation.do(partial(bound.ask, arguments, deadline))

        return SimpleNamespace(ask=ask, ask_async=bound.ask_async)

    def _await(self, seconds: float | None, condition: Callable[[], bool], wake: threading.Event) -> bool:
        self._simulation.run(until=condition, at_most=PATIENCE if seconds is None else seconds)
        if not condition() and self._simulation.failed:
            raise ComponentError(f"{', '.join(self._simulation.failed)} failed; the log says why")
        return True

    def _identity(self) -> bytes:
        """The next id of a goal. Ids are the same in each run."""
        return hashlib.blake2b(f"{NAME} {next(self._numbers)}".encode(), digest_size=16).digest()


class _Offered(NamedTuple):
    """An action that a component of the network executes."""

    port: Port
    action: Action
    place: str
    """`planner/Planner`"""
    middleware: str


def _actions(part: Part) -> Iterator[tuple[str, _Offered]]:
    settings = part.settings
    for port, action in part.component.actions():
        name = names.channel(settings.namespace, settings.instance, port.label, action.name)
        middleware, *_ = settings.middlewares(port, action.name, part.middleware)
        yield name, _Offered(port, action, name.rpartition("/")[0], middleware)
