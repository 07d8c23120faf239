"""The transport of virtual time: what a component sends is delivered before the next event, in the order sent.

A call runs its server at once, on the thread that calls. Payloads are bytes, as they would be between processes, so
that they can be recorded, and no component can change what another one holds. QoS is that of the other transports.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Protocol, TypeVar

from ..contract.interface import Pattern
from ..errors import AlreadyServed, Closed, ContractMismatch, Timeout, TransportError, Unreachable
from ..runtime.clock import SECOND, ns
from ..transports.base import (
    ANY_QOS,
    Channel,
    Reply,
    Service,
    Sink,
    Source,
    Statistics,
    SupportsSources,
    SupportsSubscribers,
    TransportFactory,
    depth_of,
    mismatch,
    pass_on,
    reply_of,
)
from ..transports.limits import COMMANDS_WAITING
from ..transports.reception import Reception
from ..wire.cdr import Cdr
from ..wire.codec import Codec, Payload
from ..wire.names import matches
from .executor import Executor, Pause

log = logging.getLogger("robocomp.transport.virtual")

L = TypeVar("L", bound="_Link")


class Listener(Protocol):
    """Gets all that is said."""

    def sent(self, sender: str, channel: Channel, payload: Payload) -> None:
        """A publication, a command or the request of a query."""
        ...

    def answered(self, channel: Channel, reply: Reply) -> None: ...


class Air:
    """What the transports of one simulation share: their links, and who listens to all of them."""

    def __init__(self, executor: Executor, listener: Listener) -> None:
        self.executor, self.listener = executor, listener
        self.links: list[_Link] = []
        self.version = 0
        """Grows with every link that comes or goes."""

    def factory(self, middleware: str) -> TransportFactory:
        """Opens what stands in for a middleware: links of different ones do not meet."""
        return lambda config: VirtualTransport(self, config.owner, middleware)

    def seconds(self) -> float:
        return self.executor.now / SECOND

    def instant(self) -> int:
        return self.executor.now


class VirtualTransport:
    capabilities = ANY_QOS

    def __init__(self, air: Air, owner: str, middleware: str, *, hand_over: bool = False) -> None:
        """`hand_over`: its servers run as events of their own. Then calls end at their deadline, even if a handler
        waits longer. Otherwise calls are faster."""
        self.codec: Codec = Cdr()
        self.air, self.owner, self.middleware, self.hand_over = air, owner, middleware, hand_over
        self._links: list[_Link] = []
        self._closed = False

    def outlet(self, channel: Channel) -> Outlet:
        return self._open(Outlet(self, channel))

    def inlet(self, channel: Channel, sink: Sink) -> Inlet:
        return self._open(Inlet(self, channel, sink))

    def caller(self, channel: Channel) -> Caller:
        return self._open(Caller(self, channel))

    def server(self, channel: Channel, service: Service) -> Server:
        return self._open(Server(self, channel, service))

    def close(self) -> None:
        self._closed = True
        while self._links:
            self._links.pop().close()

    def _open(self, link: L) -> L:
        if self._closed:
            raise Closed("the transport is closed")
        link.open()
        self._links.append(link)
        return link


class _Link:
    """One end of a channel; `facing` is the class of the other end."""

    facing: type[_Link]
    alone = False
    """Whether a channel may have only one such link."""

    def __init__(self, transport: VirtualTransport, channel: Channel) -> None:
        self.transport, self.channel, self.air = transport, channel, transport.air
        self.stats = Statistics()
        self.closed = False
        self._looked = -1
        self._peers: list[_Link] = []
        self._reported: set[str] = set()

    def open(self) -> None:
        """Raises AlreadyServed."""
        if self.alone and any(type(other) is type(self) and self._meets(other) for other in self.air.links):
            raise AlreadyServed(f"{self.channel.name}: already served")
        self.air.links.append(self)
        self.air.version += 1
        for other in self.air.links:
            if isinstance(other, self.facing) and self._meets(other) and self._agrees(other) and other._agrees(self):
                self.met(other)
                other.met(self)

    def met(self, other: _Link) -> None:
        """A peer with the same contract has come."""

    def peers(self) -> list[_Link]:
        """The peers with the same contract. Raises Closed, and ContractMismatch if there are only others."""
        self.check_open()
        if self._looked != self.air.version:
            named = [each for each in self.air.links if isinstance(each, self.facing) and self._meets(each)]
            self._peers = [each for each in named if self._agrees(each)]
            if named and not self._peers:
                raise ContractMismatch(mismatch(self.channel, named[0].channel.type))
            self._looked = self.air.version
        return self._peers

    def wait_peer(self, timeout: float) -> bool:
        return bool(self.peers())

    def check_open(self) -> None:
        if self.closed:
            raise Closed(self.channel.name)

    def close(self) -> None:
        if not self.closed:
            self.closed = True
            self.air.links.remove(self)
            self.air.version += 1

    def _meets(self, other: _Link) -> bool:
        """Whether the other end has a matching channel. With `*`, links of the same component do not match."""
        mine, theirs = self.channel, other.channel
        same_name = matches(mine.name, theirs.name) or matches(theirs.name, mine.name)
        itself = self.transport is other.transport and mine.name != theirs.name
        same_way = self.transport.middleware == other.transport.middleware and mine.pattern is theirs.pattern
        return same_name and same_way and not itself

    def _agrees(self, other: _Link) -> bool:
        """Whether the other end has the same contract; if not, that is reported once."""
        same = self.channel.type.fingerprint == other.channel.type.fingerprint
        if not same and other.channel.name not in self._reported:
            self._reported.add(other.channel.name)
            log.error("%s", mismatch(self.channel, other.channel.type))
            self.stats.mismatched += 1
        return same


class Outlet(_Link, SupportsSubscribers):
    def __init__(self, transport: VirtualTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._lossy = channel.pattern is Pattern.PUBLISH and not channel.qos.reliable
        self._history: deque[tuple[int, Payload]] = deque(maxlen=channel.qos.depth if channel.qos.latched else 0)
        """The latest messages, each with its time in ns."""

    @property
    def has_subscribers(self) -> bool:
        """Whether there is a subscriber, or a late one may want latched messages."""
        try:
            return bool(self.peers()) or bool(self._history.maxlen)
        except ContractMismatch:
            return False

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        try:
            peers = self.peers()
        except ContractMismatch:
            if self.channel.pattern is Pattern.COMMAND:
                raise
            peers = []
        if self.channel.pattern is Pattern.COMMAND and not peers:
            raise Unreachable(f"{self.channel.name}: no server")
        executor = self.air.executor
        executor.check_thread()
        to = self.channel if self.channel.pattern is Pattern.PUBLISH else peers[0].channel
        self.air.listener.sent(self.transport.owner, to, payload)
        if self._history.maxlen:
            self._history.append((executor.now, payload))
        until = executor.now + ns(deadline)
        for peer in list(peers):
            assert isinstance(peer, Inlet)
            if not peer.put(self.channel.name, executor.now, payload, may_be_lost=self._lossy, until=until):
                raise Timeout(f"{self.channel.name}: a subscriber is too slow")

    def met(self, other: _Link) -> None:
        """Give a late subscriber what it missed."""
        if other.channel.qos.latched:
            assert isinstance(other, Inlet)
            for instant, payload in self._history:
                other.put(self.channel.name, instant, payload, may_be_lost=True, until=instant)


class Inlet(_Link, SupportsSources):
    facing = Outlet

    def __init__(self, transport: VirtualTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        topic = channel.pattern is Pattern.PUBLISH
        self.alone = not topic
        self._depth = depth_of(channel.qos) if topic else COMMANDS_WAITING
        self._lossy = topic and not channel.qos.reliable
        self._sink = sink
        self._waiting: deque[Payload] = deque()
        self._delivering = False
        self._wanted: deque[Pause] = deque()
        """Senders that wait for room."""
        self._reception = Reception(channel, self.stats, self._through, self.air.seconds, self.air.instant)

    def put(self, name: str, instant: int, payload: Payload, *, may_be_lost: bool, until: int) -> bool:
        """Take a message of that channel; False if there was no room until that instant."""
        if self._reception.on:
            payload = self._reception.admit(name, instant, payload)
        while len(self._waiting) >= self._depth and not self.closed:
            if self._lossy:
                self._waiting.popleft()
                self.stats.dropped += 1
            elif may_be_lost:
                self.stats.dropped += 1
                return True
            elif not self._wait_for_room(until):
                return False
        if not self.closed:
            self._waiting.append(payload)
            self.air.executor.do(self._deliver)
        return True

    def met(self, other: _Link) -> None:
        self._reception.meet([Source(other.channel.name, other.channel.qos)])

    def sources(self) -> list[Source]:
        try:
            return [Source(outlet.channel.name, outlet.channel.qos) for outlet in self.peers()]
        except ContractMismatch:
            return []

    def close(self) -> None:
        super().close()
        self._waiting.clear()
        self._tell_room()

    def _wait_for_room(self, until: int) -> bool:
        pause = Pause(self.air.executor)
        self._wanted.append(pause)
        return pause.wait(until)

    def _tell_room(self) -> None:
        while self._wanted:
            self._wanted.popleft().end()

    def _deliver(self) -> None:
        """Deliver one message, unless another one is being delivered, perhaps by a handler that waits."""
        if self._delivering or not self._waiting:
            return
        self._delivering = True
        payload = self._waiting.popleft()
        self._tell_room()
        self.stats.received += 1
        try:
            self._sink(payload)
        finally:
            self._delivering = False
            if self._waiting:
                self.air.executor.do(self._deliver)

    def _through(self, wrapper: Callable[[Sink], Sink]) -> None:
        self._sink = wrapper(self._sink)


Outlet.facing = Inlet


class Caller(_Link):
    def ask(self, payload: Payload, deadline: float) -> Reply:
        """Run the server on this thread. If it takes longer than the deadline, the call fails, but not before."""
        executor = self.air.executor
        executor.check_thread()
        server, until = self._server(), executor.now + ns(deadline)
        self.air.listener.sent(self.transport.owner, server.channel, payload)
        reply = server.serve(payload)
        if isinstance(reply, Future):
            pause = Pause(executor)
            reply.add_done_callback(lambda _: pause.end())
            if not pause.wait(until):
                raise self._late(deadline)
            self.check_open()
            reply = reply.result()
        if executor.now > until:
            raise self._late(deadline)
        self.air.listener.answered(server.channel, reply)
        return reply

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        self._server()
        future: Future[Reply] = Future()
        self.air.executor.do(partial(self._run, future, payload, deadline))
        return future

    def _run(self, future: Future[Reply], payload: Payload, deadline: float) -> None:
        """Make a call, and end its future."""
        if not future.set_running_or_notify_cancel():
            return
        try:
            future.set_result(self.ask(payload, deadline))
        except TransportError as exc:
            future.set_exception(exc)

    def _late(self, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: no answer in {deadline:g} s")

    def _server(self) -> Server:
        found = next(iter(self.peers()), None)
        if found is None:
            raise Unreachable(f"{self.channel.name}: no server")
        assert isinstance(found, Server)
        return found


class Server(_Link):
    facing = Caller
    alone = True

    def __init__(self, transport: VirtualTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._service = service

    def serve(self, payload: Payload) -> Reply | Future[Reply]:
        self.stats.received += 1
        if not self.transport.hand_over:
            return reply_of(self._service, payload, float("inf"))
        future: Future[Reply] = Future()
        self.air.executor.do(partial(self._answer, payload, future))
        return future

    def _answer(self, payload: Payload, future: Future[Reply]) -> None:
        reply = reply_of(self._service, payload, float("inf"))
        if isinstance(reply, Future):
            pass_on(reply, future.set_result)
        else:
            future.set_result(reply)


Caller.facing = Server
