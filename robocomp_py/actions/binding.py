"""Connects the actions of a port: a server serves queries and publishes, a client calls and subscribes.

Each action counts as one operation of its port in the settings: its middleware and its deadline hold for all its parts.
"""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from ..contract.component import Port
from ..contract.goal import Policy
from ..contract.interface import Action, Interface, Operation, Pattern, Verb, calls_of, qos_of, topics_of
from ..contract.qos import DEFAULT_QOS
from ..errors import DecodeError
from ..runtime import ports
from ..runtime.calls import Handler
from ..runtime.monitor import Monitor
from ..runtime.route import Route
from ..transports.base import Link, Reply
from ..wire.codec import Payload
from .client import ActionProxy, GoalClient
from .goal import Awaiting, ServerGoal, Times
from .server import GoalServer

if TYPE_CHECKING:
    from ..lockstep.counts import Counts

log = logging.getLogger("robocomp.worker")

_TELLING = 0.5
"""Seconds within which clients have to take the states of goals; then they learn them by their next request."""

Routes = Callable[[Port, Operation[Any], str], Route]
"""The way of a part of an action: of that port, that part, and the name of the action."""


def new_identity() -> bytes:
    return secrets.token_bytes(16)


@dataclass
class Surroundings:
    """What the actions of a component need of it."""

    monitor: Monitor
    awaiting: Awaiting
    seconds: Callable[[], float]
    """The clock of clients that are silent."""
    identity: Callable[[], bytes] = new_identity
    counts: Counts | None = None
    times: Times = field(default_factory=Times)


@dataclass
class Connected:
    """The links of the actions of one port, and their routes."""

    routes: list[Route] = field(default_factory=list)
    called: list[Link] = field(default_factory=list)
    """Those that need a server."""
    others: list[Link] = field(default_factory=list)

    @property
    def links(self) -> list[Link]:
        return [*self.called, *self.others]


def serve(port: Port, worker: object, route: Routes, around: Surroundings, connected: Connected) -> list[GoalServer]:
    """Serve the actions of a port; links are appended as they are opened."""
    routing = _Routing(port, route, connected.routes)
    proxy, told = ports.Proxy({}), _part(port, Verb.PUBLISHES, topics_of(port.interface))
    begun = len(connected.routes)
    ports.bind_proxy(told, routing, around.monitor, links=connected.others, proxy=proxy)
    if around.counts:
        around.counts.proxy(told, proxy, connected.routes[begun:])
    servers = [_server(port, each, worker, proxy, around) for each in port.interface.actions]
    asked = [part for each in port.interface.actions for part in (each.start, each.cancel)]
    calls = _part(port, Verb.IMPLEMENTS, Interface(port.interface.name, tuple(asked)))
    methods = {}
    for action, server in zip(port.interface.actions, servers, strict=True):
        methods[calls.handler(action.start.name)] = _named(server.start, action.start)
        methods[calls.handler(action.cancel.name)] = _named(server.cancel, action.cancel)
    handlers: Any = SimpleNamespace(**methods)
    if around.counts:
        handlers = around.counts.handlers(calls, handlers)
    unnoted = _Routing(port, route, [])
    for action, server in zip(port.interface.actions, servers, strict=True):
        _serve_results(action, server, unnoted(port, action.result), connected.others)
    begun = len(connected.routes)
    ports.bind_handlers(calls, handlers, routing, around.monitor, links=connected.others)
    if around.counts:
        handlers.routes(connected.routes[begun:])
    return servers


def connect(port: Port, proxy: ActionProxy, route: Routes, around: Surroundings, connected: Connected) -> GoalClient:
    """Connect a proxy with the server of its actions; links are appended as they are opened."""
    routing = _Routing(port, route, connected.routes)
    calls, asked = _part(port, Verb.REQUIRES, calls_of(port.interface)), ports.Proxy({})
    ports.bind_proxy(calls, routing, around.monitor, links=connected.called, proxy=asked)
    if around.counts:  # requests for results wait for the clock, so that it must not wait for them
        results = {each.result.name: asked._bound[each.result.name] for each in port.interface.actions}
        around.counts.proxy(calls, asked, connected.routes)
        asked._bound = {**asked._bound, **results}
    client = GoalClient(
        port.interface.actions,
        asked._bound,
        around.awaiting,
        around.identity,
        around.times,
        run=around.monitor.run,
        holds=around.counts is not None,
    )
    around.monitor.at_end(client.turn_away)
    hearing = replace(_part(port, Verb.SUBSCRIBES, topics_of(port.interface)), concurrent=True)
    methods = {}
    for action in port.interface.actions:
        methods[hearing.handler(action.status.name)] = _named(client.told, action.status)
        if action.told:
            methods[hearing.handler(action.told.name)] = _named(client.heard, action.told)
    handlers: Any = SimpleNamespace(**methods)
    begun = len(connected.routes)
    if around.counts:
        handlers = around.counts.handlers(hearing, handlers)
    ports.bind_handlers(hearing, handlers, routing, around.monitor, links=connected.others)
    if around.counts:
        handlers.routes(connected.routes[begun:])
    proxy._goals = client
    return client


class _Routing:
    """The routes of the parts of a port's actions. Notes them in order."""

    def __init__(self, port: Port, route: Routes, noted: list[Route]) -> None:
        self._port, self._route, self._noted = port, route, noted
        self._actions = {part.name: each.name for each in port.interface.actions for part in each.parts}

    def __call__(self, port: Port, operation: Operation[Any]) -> Route:
        route = self._route(self._port, operation, self._actions[operation.name])
        if operation.pattern is Pattern.PUBLISH:
            qos = qos_of(operation)
            route = replace(route, qos=qos, also=tuple(replace(each, qos=qos) for each in route.also))
        self._noted.append(route)
        return route


def _part(port: Port, verb: Verb, interface: Interface) -> Port:
    """A port for parts of its actions."""
    return Port(verb, interface, port.number, DEFAULT_QOS, middleware=port.middleware)


def _server(port: Port, action: Action, worker: object, proxy: ports.Proxy, around: Surroundings) -> GoalServer:
    def tell(operation: Operation[None], arguments: tuple[Any, ...]) -> None:
        proxy._send(operation, arguments, _TELLING)

    policy = Policy(dict(port.policies).get(action.name, Policy.REFUSE))
    method = getattr(worker, port.handler(action.name))
    kind = action.goal or ServerGoal
    note = around.monitor.tallies.note_failure
    return GoalServer(action, policy, method, tell, around.seconds, around.times, kind, note)


def _serve_results(action: Action, server: GoalServer, route: Route, links: list[Link]) -> None:
    for each in route.all:
        handler = Handler(action.result, each.transport.codec, server.poll)
        service = partial(_answer, handler, server, server.codec(each.transport.codec))
        channel = replace(ports.checked_channel(each, action.result, Pattern.QUERY), exclusive=False)
        links.append(each.transport.server(channel, service))


def _answer(
    handler: Handler, server: GoalServer, codec: int, payload: Payload, expires: float
) -> Reply | Future[Reply]:
    try:
        goal, wait = handler.decode(payload)
    except DecodeError as exc:
        return handler.failed(exc)
    return server.poll(goal, wait, codec)


def _named(method: Callable[..., Any], operation: Operation[Any]) -> Callable[..., Any]:
    """A function that messages call by the name of the part."""

    def called(*arguments: Any) -> Any:
        return method(*arguments)

    called.__qualname__ = f"{operation.interface}.{operation.name}".replace("::", ".")
    return called
