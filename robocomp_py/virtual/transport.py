"""The transport of virtual time: what a component sends is delivered before the next event, in the order sent.

A call runs its server at once, on the thread that calls. Payloads are bytes, as they would be between processes, so
that they can be recorded, and no component can change what another one holds. QoS is that of the other transports.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import weakref
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import NamedTuple, Protocol

from ..contract.interface import Pattern
from ..errors import Timeout, TransportError, Unreachable
from ..runtime.clock import SECOND, ns
from ..transports.base import (
    ANY_QOS,
    Channel,
    Reply,
    Service,
    Sink,
    Source,
    SupportsSources,
    SupportsSubscribers,
    TransportFactory,
    depth_of,
    pass_on,
    reply_of,
)
from ..transports.bus import Bus, BusLink, BusTransport
from ..transports.leader_followers import Job
from ..transports.limits import COMMANDS_WAITING
from ..transports.link import Ends
from ..transports.reception import Reception
from ..transports.senders import From, Sender
from ..wire.cdr import Cdr
from ..wire.codec import Codec, Payload
from .executor import Executor, Pause


class Listener(Protocol):
    """Gets all that is said."""

    def sent(self, sender: str, channel: Channel, payload: Payload) -> None:
        """A publication, a command or the request of a query."""
        ...

    def answered(self, channel: Channel, reply: Reply) -> None: ...


class Air:
    """What the transports of one simulation share: their links, and the listener to all that they say."""

    def __init__(self, executor: Executor, listener: Listener) -> None:
        self.executor, self.listener, self.bus = executor, listener, Bus()
        self.sources = itertools.count(1)
        """The numbers of publishers: not random, so that runs can be equal."""

    def factory(self, middleware: str) -> TransportFactory:
        """Opens what stands in for a middleware: links of different ones do not meet."""
        return lambda config: VirtualTransport(self, config.owner, middleware)

    def seconds(self) -> float:
        return self.executor.now / SECOND

    def instant(self) -> int:
        return self.executor.now


class VirtualTransport(BusTransport):
    capabilities = ANY_QOS

    def __init__(self, air: Air, owner: str, middleware: str, *, hand_over: bool = False) -> None:
        """`hand_over`: its servers run as events of their own. Then calls end at their deadline, even if a handler
        waits longer. Otherwise calls are faster."""
        super().__init__(air.bus)
        self.codec: Codec = Cdr()
        self.sender: Sender = lambda: owner
        self.air, self.owner, self.group, self.hand_over = air, owner, f"{middleware} ", hand_over

    def do(self, job: Job) -> None:
        self.air.executor.do(job)

    def release(self, everything: contextlib.ExitStack) -> None: ...


class _Link(BusLink[VirtualTransport]):
    def __init__(self, transport: VirtualTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.air = transport.air

    def wait_peer(self, timeout: float) -> bool:
        """No time passes meanwhile."""
        self.check_open()
        return self.visible()


class _Sent(NamedTuple):
    """The header of a message."""

    channel: str
    source: int
    sequence: int
    instant: int
    """In ns of virtual time."""


class Outlet(_Link, SupportsSubscribers):
    sides = "outlet", "inlet"

    def __init__(self, transport: VirtualTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._lossy = channel.pattern is Pattern.PUBLISH and not channel.qos.reliable
        self._source, self._sent = next(self.air.sources), 0
        self._history: deque[tuple[_Sent, Payload]] = deque(maxlen=channel.qos.depth if channel.qos.latched else 0)
        """The latest messages."""
        self._greeted: weakref.WeakSet[Inlet] = weakref.WeakSet()
        """The subscribers that have got the history."""

    @property
    def has_subscribers(self) -> bool:
        """Whether there is a subscriber, or a late one may want latched messages."""
        return bool(self.peers() or self._history.maxlen)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        self.check_open()
        peers = self.peers()
        if self.channel.pattern is Pattern.COMMAND and not peers:
            self.counterparts(strict=True)
            raise Unreachable(f"{self.channel.name}: no server")
        executor = self.air.executor
        executor.check_thread()
        to = self.channel if self.channel.pattern is Pattern.PUBLISH else peers[0].channel
        self.air.listener.sent(self.transport.owner, to, payload)
        self._sent += 1
        sent = _Sent(self.channel.name, self._source, self._sent, executor.now)
        if self._history.maxlen:
            self._history.append((sent, payload))
        if to is not self.channel and to.signed:
            payload = From(self.transport.sender, payload)
        until = executor.now + ns(deadline)
        for peer in list(peers):
            if not peer.put(sent, payload, may_be_lost=self._lossy, until=until):
                raise Timeout(f"{self.channel.name}: a subscriber is too slow")

    def look(self) -> bool:
        """Give late subscribers what they missed."""
        for inlet in self.peers():
            if inlet.channel.qos.latched and inlet not in self._greeted:
                self._greeted.add(inlet)
                for sent, payload in self._history:
                    inlet.put(sent, payload, may_be_lost=True, until=sent.instant)
        return True


class Inlet(_Link, SupportsSources):
    sides = "inlet", "outlet"

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

    def put(self, sent: _Sent, payload: Payload, *, may_be_lost: bool, until: int) -> bool:
        """Take a message; False if there was no room until that instant."""
        if self._reception.on:
            payload = self._reception.admit(sent.channel, sent.instant, payload, sent.source, sent.sequence)
        while len(self._waiting) >= self._depth and not self.closed.is_set():
            if self._lossy:
                self._waiting.popleft()
                self.stats.dropped += 1
            elif may_be_lost:
                self.stats.dropped += 1
                return True
            elif not self._wait_for_room(until):
                return False
        if not self.closed.is_set():
            self._waiting.append(payload)
            self.air.executor.do(self._deliver)
        return True

    def look(self) -> bool:
        self._reception.meet(self.sources())
        return True

    def sources(self) -> list[Source]:
        return [Source(outlet.channel.name, outlet.channel.qos) for outlet in self.peers()]

    def release(self) -> None:
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


class Caller(_Link):
    sides = "caller", "server"

    def ask(self, payload: Payload, deadline: float) -> Reply:
        """Run the server on this thread. If it takes longer than the deadline, the call fails, but not before."""
        executor = self.air.executor
        executor.check_thread()
        server, until = self._server(), executor.now + ns(deadline)
        self.air.listener.sent(self.transport.owner, server.channel, payload)
        reply = server.serve(From(self.transport.sender, payload) if server.channel.signed else payload)
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
        self.check_open()
        server: Server
        for server in self.peers():
            return server
        self.counterparts(strict=True)
        raise Unreachable(f"{self.channel.name}: no server")


class Server(_Link):
    sides = "server", "caller"
    alone = True

    def __init__(self, transport: VirtualTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._service = service

    def serve(self, payload: Payload) -> Reply | Future[Reply]:
        self.stats.received += 1
        if not self.transport.hand_over:
            return reply_of(self._service, payload, math.inf)
        future: Future[Reply] = Future()
        self.air.executor.do(partial(self._answer, payload, future))
        return future

    def _answer(self, payload: Payload, future: Future[Reply]) -> None:
        reply = reply_of(self._service, payload, math.inf)
        if isinstance(reply, Future):
            pass_on(reply, future.set_result)
        else:
            future.set_result(reply)


VirtualTransport.ends = Ends(Outlet, Outlet, Inlet, Inlet, Caller, Server)
