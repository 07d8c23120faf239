"""The links of one component, from opening them to closing them, and the wait for the peers that it needs."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ..contract.component import Port
from ..contract.interface import Operation, Pattern, Verb
from ..contract.middleware import carrier
from ..contract.qos import QoS
from ..errors import AlreadyServed, ConfigurationError, TransportError, Unreachable
from ..transports import headroom
from ..transports.base import (
    Link,
    Transport,
    TransportConfig,
    TransportFactory,
    about_to_block,
    gathering,
    wait_connected,
)
from ..wire import names
from . import commonbehavior, introspecting, ports
from .commonbehavior import CommonBehavior
from .introspecting import Introspection
from .route import Route, Router
from .status import Bound

if TYPE_CHECKING:
    from ..actions.binding import Surroundings
    from ..actions.goals import Goals
    from ..lockstep.counts import Counts
    from .instances import Entry, NamedInstances
    from .monitor import Monitor
    from .settings import Settings, Way
    from .watching import Watched, Watching
    from .worker import Worker

log = logging.getLogger("robocomp.worker")

_REMIND = 5.0
"""Seconds between messages that name the peer a component waits for."""

_DISCOVERY = 0.2
"""Seconds until the first of these messages."""

_CONNECTING = 2.0
"""Seconds to wait for visible publishers and subscribers to connect; then the component starts without the rest."""


class Connections:
    """The links of a component's ports, and the transports that they use.

    `open`, then `are_peers_there` until it returns True, then `close_links` and `close`, all on one thread.
    """

    def __init__(
        self,
        worker: Worker[Any],
        settings: Settings,
        find: Callable[[str], TransportFactory],
        wanted: Callable[[], bool],
        monitor: Monitor,
        watching: Watching,
        counts: Counts | None = None,
        differs: Callable[[str], object] = lambda text: None,
        goals_need: Callable[[], Surroundings] | None = None,
    ) -> None:
        """`wanted` returns False when opening a transport, which may take a while, should be given up.

        `differs` is told how named instances differ from what the network declares; "" if they no longer do.
        `goals_need` is given if there are actions.
        """
        self._worker, self._settings, self._component = worker, settings, worker.component
        self._monitor, self._watching, self._counts = monitor, watching, counts
        self._transports = _Transports(settings, find, wanted)
        self.goals: Goals | None = None
        """What is done for its actions, if it has some."""
        if goals_need:
            from ..actions.goals import Goals  # few components need it

            self.goals = Goals(goals_need())
        self._links: list[Link] = []
        """Links of handlers."""
        self._proxied: list[Link] = []
        """Links of proxies."""
        self.bound: list[Bound] = []
        """The ports with their routes and links."""
        self._instances: list[NamedInstances[Any]] = []
        """Of each port that has them."""
        self._differs, self._difference = differs, ""
        self._changing = threading.Lock()
        """Held while links are opened or closed together, and while `bound` changes."""
        self._required: list[tuple[Port, Link]] = []
        self._missing: deque[tuple[Port, Link]] = deque()
        """The required links without a visible peer."""
        self._unconnected: deque[Link] | None = None
        """The links of topics that are not known to be connected; None until all required peers are visible."""
        self._begun = 0.0
        self._is_ready = False
        self._told: float | None = None

    def open(self, behavior: CommonBehavior, introspection: Introspection) -> None:
        """Open all links. The arguments serve CommonBehavior and Introspection, unless the component implements these
        itself."""
        with self._transports.gathering():
            self._bind_own(behavior, introspection)
            self._bind_all()
        self._begin_instances()
        self._missing = deque(self._required)
        self._begun = time.monotonic()

    @property
    def awaited(self) -> str:
        """The first required interface that nothing implements yet, and the peer that is meant; "" if all are there."""
        if not self._missing:
            return ""
        port, _ = self._missing[0]
        return f"{port.interface.short} ({self._settings.peer_of(port)})"

    def are_peers_there(self, patience: float = 0.0) -> bool:
        """Whether all required peers are visible, and visible publishers and subscribers connected.

        Waits for the next of them for `patience` seconds. After some time, a component starts without connected
        publishers and subscribers; for a required peer it raises Unreachable.
        """
        while self._missing:
            port, link = self._missing[0]
            if not link.wait_peer(patience):
                self._note_missing(port)
                return False
            self._missing.popleft()
        now = time.monotonic()
        if self._unconnected is None:
            self._unconnected = deque(link for bound in self.bound if bound.port.verb.is_topic for link in bound.links)
            self._begun = now
        left = self._begun + _CONNECTING - now
        while self._unconnected:
            if not wait_connected(self._unconnected[0], min(patience, max(0.0, left))):
                if left > 0:
                    return False
                log.info("some publishers or subscribers are not connected after %g s; starting", _CONNECTING)
                break
            self._unconnected.popleft()
        self._unconnected.clear()
        return True

    def tell_missing(self) -> None:
        """Warn of named instances that the network declares and the component has not added."""
        for instances in self._instances:
            instances.tell_missing()
        self._is_ready = True
        self.changed()

    def changed(self) -> None:
        """Tell how named instances differ from what the network declares, once the component is ready."""
        text = "; ".join(each for instances in self._instances for each in instances.differences())
        if self._is_ready and text != self._difference:
            self._difference = text
            self._differs(text)

    def suspended(self) -> contextlib.AbstractContextManager[None]:
        return self._monitor.suspended()

    def bind(self, port: Port, entry: Entry[Any]) -> None:
        """Connect a named instance. May be called on any thread."""
        routes: list[Route] = []

        def route(port: Port, operation: Operation[Any]) -> Route:
            routes.append(self._route(port, operation, entry.name))
            return routes[-1]

        watches, links = _Noting(self._watching, entry.watched), entry.links
        with self._changing, self._transports.gathering():
            if isinstance(entry.given, ports.Proxy):
                ports.bind_proxy(port, route, self._monitor, watches, links, entry.given)
                if self._counts:
                    entry.counters = self._counts.proxy(port, entry.given, routes)
            else:
                handlers = entry.handlers(port)
                counted = self._counts.handlers(port, handlers) if self._counts else None
                ports.bind_handlers(
                    port, counted or handlers, route, self._monitor, watches, links=links, signed=entry.reads_caller
                )
                if counted:
                    entry.counters = counted.routes(routes)
            entry.bound = Bound(port, routes, tuple(links), entry.name)
            self.bound = [*self.bound, entry.bound]
        if self._is_ready:
            headroom.check(self._settings.instance)
        if self._counts and self._is_ready:  # it publishes at an instant, and no subscriber may miss that
            about_to_block()
            self._connect(entry.bound)

    def connect_instances(self) -> None:
        """Wait until visible subscribers are connected to the named instances that publish."""
        for bound in self.bound:
            if bound.instance:
                self._connect(bound)

    def _connect(self, bound: Bound) -> None:
        end = time.monotonic() + _CONNECTING
        for link in bound.links if bound.port.verb.is_topic else ():
            wait_connected(link, max(0.0, end - time.monotonic()))

    def unbind(self, entry: Entry[Any]) -> None:
        with self._changing:
            self.bound = [each for each in self.bound if each is not entry.bound]
        if self._counts:
            self._counts.drop(entry.counters)
        for watched in entry.watched:
            self._watching.leave(watched)
        self._monitor.tallies.drop(entry.links)
        ports.close_all(entry.links)

    def serve(self, port: Port, handlers: object) -> None:
        """Serve an interface that is not one of the component's own. Its handlers run outside of the monitor."""
        self._links += ports.bind_handlers(port, handlers, self._route, self._monitor, outside=True)

    def reach(self, port: Port, instance: str) -> tuple[Any, Callable[[], None]]:
        """A proxy for a required interface that is not one of the component's own, at `/namespace/instance`.

        Also returns a function that closes its links, for a caller that needs it no longer than the component runs.
        """
        proxy, links = ports.bind_proxy(port, self._route_to(port, instance), self._monitor)
        with self._changing:
            self._proxied += links

        def close() -> None:
            with self._changing:
                self._proxied = [each for each in self._proxied if each not in links]
            self._monitor.tallies.drop(links)
            ports.close_all(links)

        return proxy, close

    def hear(self, port: Port, handlers: object, instance: str) -> None:
        """Subscribe to an interface that is not one of the component's own, at `/namespace/instance`.

        Its handlers run outside of the monitor.
        """
        self._links += ports.bind_handlers(port, handlers, self._route_to(port, instance), self._monitor, outside=True)

    def _route_to(self, port: Port, instance: str) -> Router:
        where = names.resolve(f"{instance}/{port.interface.short}", self._settings.namespace, "")

        def route(port: Port, operation: Operation[Any]) -> Route:
            return replace(self._route(port, operation), channel=names.channel(*where, operation.name))

        return route

    def publish(self, port: Port) -> tuple[Any, Callable[[], None]]:
        """A proxy for a published interface that is not one of the component's own, and what closes its links.

        Its messages are not counted. The links are not closed otherwise.
        """
        links: list[Link] = []
        try:
            with self._changing:
                proxy, _ = ports.bind_proxy(port, self._route, self._monitor, links=links)
        except BaseException:  # Ctrl-C, too: no link stays open
            ports.close_all(links)
            raise
        self._monitor.tallies.drop(links)
        return proxy, partial(ports.close_all, links)

    def close_links(self) -> None:
        for instances in self._instances:
            instances.end()
        if self.goals:
            self.goals.close()
        try:
            with self._changing, self._transports.gathering():
                ports.close_all(self._proxied)  # first, because it ends the calls that handlers and hooks wait for
                ports.close_all(self._links)
        except TransportError as exc:
            log.warning("%s", exc)  # closing the transport closes the remaining links

    def close(self) -> None:
        self._transports.close()

    def _bind_own(self, behavior: CommonBehavior, introspection: Introspection) -> None:
        own = commonbehavior.port_of(self._component)
        if own:
            try:
                self._links += ports.bind_handlers(own, behavior, self._route, self._monitor, lazy=True)
            except AlreadyServed as exc:
                name = self._settings.instance
                raise AlreadyServed(
                    f"an instance `{name}` is already running; stop it, or give this one another name: with --name, "
                    f"or in the .ddsl of its network ({exc})"
                ) from exc
        told = introspecting.port_of(self._component)
        if told:
            claimed = [self._carrier(self._settings.port(own, "").middleware)] if own else ()
            bind = partial(ports.bind_handlers, told, introspection, self._route, self._monitor)
            self._links += bind(lazy=True, claimed=claimed)

    def _bind_all(self) -> None:
        provided = [port for port in self._component.ports if port.verb.provides]
        wanted = [port for port in self._component.ports if not port.verb.provides]
        for port in (*provided, *wanted):
            if port.each:
                continue
            links = self._bind(port)
            (self._proxied if port.verb.has_proxy else self._links).extend(links)
            if port.verb is Verb.REQUIRES:
                self._required += ((port, link) for link in links)
            if self.goals and port.interface.actions_under(port.verb):
                self._bind_actions(port, self.goals)

    def _begin_instances(self) -> None:
        for port in self._component.named:
            instances: NamedInstances[Any] = getattr(self._worker, port.attribute)
            self._instances.append(instances)
            instances.begin(self)

    def _bind(self, port: Port) -> list[Link]:
        routes: list[Route] = []

        def route(port: Port, operation: Operation[Any]) -> Route:
            routes.append(self._route(port, operation))
            return routes[-1]

        if port.verb.has_proxy:
            proxy, links = ports.bind_proxy(port, route, self._monitor, self._watching)
            if self._counts:
                self._counts.proxy(port, proxy, routes)
            setattr(self._worker, port.attribute, proxy)
        elif self._counts:
            handlers, signed = self._counts.handlers(port, self._worker), self._worker.reads_caller
            links = ports.bind_handlers(port, handlers, route, self._monitor, self._watching, signed=signed)
            handlers.routes(routes)
        else:
            signed = self._worker.reads_caller
            links = ports.bind_handlers(port, self._worker, route, self._monitor, self._watching, signed=signed)
        self.bound.append(Bound(port, routes, links))
        return links

    def _bind_actions(self, port: Port, goals: Goals) -> None:
        connected = goals.bind(port, self._worker, self._route_of_part)
        (self._proxied if port.verb.has_proxy else self._links).extend(connected.links)
        self._required += ((port, link) for link in connected.called)
        bound = self.bound.pop()
        routes, links = (*bound.routes, *connected.routes), (*bound.links, *connected.links)
        self.bound.append(replace(bound, routes=routes, links=links))

    def _route_of_part(self, port: Port, operation: Operation[Any], action: str) -> Route:
        return self._route(port, operation, action=action)

    def _route(self, port: Port, operation: Operation[Any], instance: str = "", action: str = "") -> Route:
        """`instance` is the name of a named one, and `action` what this is a part of."""
        chosen = self._settings.port(port, action or operation.name, instance)
        if port.verb.provides:
            name = instance or self._settings.instance
            where = (self._settings.namespace, name, self._component.segment(port))
        else:
            where = names.resolve(chosen.source or "", self._settings.namespace, port.interface.short)
        assert chosen.qos is not None
        assert chosen.deadline is not None
        middleware = self._carrier(chosen.middleware)
        route = Route(
            self._transports[middleware],
            middleware,
            names.channel(*where, operation.name),
            chosen.qos,
            chosen.deadline,
        )
        if not chosen.also:
            return route
        return replace(route, also=tuple(self._further(route, port, operation, way) for way in chosen.also))

    def _further(self, route: Route, port: Port, operation: Operation[Any], way: Way) -> Route:
        middleware = self._carrier(way.middleware) if way.middleware else route.middleware
        channel = route.channel
        if way.source is not None:
            where = names.resolve(way.source, self._settings.namespace, port.interface.short)
            channel = names.channel(*where, operation.name)
        return replace(route, transport=self._transports[middleware], middleware=middleware, channel=channel)

    def _carrier(self, middleware: str | None) -> str:
        return carrier(middleware, self._worker.middleware)

    def _note_missing(self, port: Port) -> None:
        """Name a missing peer from time to time; raises Unreachable after the configured time."""
        now = time.monotonic()
        peer, timeout = self._settings.peer_of(port), self._settings.startup_timeout
        if now - self._begun > timeout:
            waited = f"(waited {timeout:g} s for {peer})"
            lacking = _lacking(port, self._required)
            raise Unreachable(
                f"{lacking} {waited}"
                if lacking
                else f"no component implements {port.interface.short} {waited}; "
                f"start one, or set ports.{port.name}.from"
            )
        if now - self._begun >= _DISCOVERY if self._told is None else now - self._told > _REMIND:
            lacking = _lacking(port, self._required) if self._told else ""  # at first, discovery is not complete
            self._told = now
            what = lacking or f"waiting for a component that implements {port.interface.short}"
            log.info("%s (%s)", what, peer)


class _Noting:
    """Notes the watches of one named instance, so that they end with it."""

    def __init__(self, watching: Watching, noted: list[Watched]) -> None:
        self._watching, self._noted = watching, noted

    def of(self, port: Port, operation: str, pattern: Pattern, qos: QoS) -> Watched | None:
        watched = self._watching.of(port, operation, pattern, qos)
        if watched:
            self._noted.append(watched)
        return watched


def _lacking(port: Port, required: Sequence[tuple[Port, Link]]) -> str:
    """The message about an interface of which only some operations are found; "" if that is not the case."""
    found = [link.wait_peer(0) for each, link in required if each is port]
    names = [operation.name for operation, _ in port.interface.under(port.verb)]
    names += [part.name for action in port.interface.actions for part in action.queries]
    if len(found) != len(names):  # an operation has several routes
        return ""
    absent = [f"`{name}`" for name, there in zip(names, found, strict=True) if not there]
    if not any(found) or not absent:
        return ""
    return (
        f"a component implements {port.interface.short} without {', '.join(absent)}: it was generated from another "
        "definition; run rcgen for both and restart them"
    )


class _Transports:
    """The transports a component uses, each opened when first used, all closed together."""

    def __init__(self, settings: Settings, find: Callable[[str], TransportFactory], wanted: Callable[[], bool]) -> None:
        self._settings, self._find, self._wanted = settings, find, wanted
        self._open: dict[str, Transport] = {}
        self._gathering: contextlib.ExitStack | None = None

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        """While entered, transports may delay the announcement of links that are opened or closed."""
        try:
            with contextlib.ExitStack() as self._gathering:
                for transport in self._open.values():
                    self._gathering.enter_context(gathering(transport))
                yield
        finally:
            self._gathering = None

    def __getitem__(self, name: str) -> Transport:
        if name not in self._open:
            options: Mapping[str, Any] = self._settings.transports.get(name, {})
            try:
                owner = names.whole(self._settings.instance, self._settings.namespace)[1:]
                config = TransportConfig(options, owner, self._wanted)
                self._open[name] = self._find(name)(config)
            except ConfigurationError as exc:
                raise ConfigurationError(f"transports.{name}: {exc}") from exc
            if self._gathering:
                self._gathering.enter_context(gathering(self._open[name]))
        return self._open[name]

    def close(self) -> None:
        while self._open:
            name, transport = self._open.popitem()
            try:
                transport.close()
            except Exception:  # of any transport: the others must be closed, too
                log.exception("closing the transport %s", name)
