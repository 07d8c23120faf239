"""Transport `inproc`: threads of one process. The reference implementation of the contract; read it first.

Transports opened on the same bus see each other. Payloads are passed on unchanged; the codec
`identity` makes them immutable values.

Changing threads twice takes ten times as long as the rest of a call. So the calling thread runs the
service itself, once the service has proved to be prompt; see `_Server`.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import queue
import threading
import time
import weakref
from collections import defaultdict, deque
from collections.abc import Callable, Hashable, Iterable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from functools import cached_property, partial

from ..contract.interface import Pattern
from ..errors import Closed, ConfigurationError, Timeout, Unreachable
from ..wire.codec import Codec, Payload
from ..wire.header import random_id
from .base import (
    ANY_QOS,
    Channel,
    Reply,
    Service,
    Sink,
    Source,
    Status,
    SupportsSources,
    SupportsSubscribers,
    TransportConfig,
    depth_of,
    options_of,
    pass_on,
)
from .bus import Bus, BusLink, BusTransport
from .leader_followers import Job, Lane, LeaderFollowers, Servant
from .limits import COMMANDS_WAITING, QUERIES_WAITING
from .link import Ends
from .pending import Pending
from .reception import Reception
from .senders import From, Sender
from .turns import Turns

PROMPT = 0.001
"""Maximum seconds of a service that calling threads may run."""

TRUSTED = 3
"""Prompt runs in a row, on threads of its own transport, before calling threads may run a service."""

_LOOK = 1.0
"""Seconds between two checks whether the program has ended without closing a transport."""

AT_ONCE = 64
"""Maximum number of requests to one server that threads of its transport run at the same time."""


_BUSES: dict[str, Bus] = defaultdict(Bus)


class InprocTransport(BusTransport):
    """Option `bus`: the name of the bus to join. Option `hand_over`: no calling thread runs a service.

    It covers calls to this transport and calls from it.
    """

    capabilities = ANY_QOS

    def __init__(self, config: TransportConfig) -> None:
        options = options_of(config, bus="default", hand_over=False)
        super().__init__(_BUSES[options["bus"]])
        self.hand_over = options["hand_over"]
        if type(self.hand_over) is not bool:
            raise ConfigurationError(f"transport option `hand_over` is true or false, not {self.hand_over!r}")
        self.owner = config.owner or "inproc"
        self.sender: Sender = lambda: config.owner
        self._work: queue.SimpleQueue[Job] = queue.SimpleQueue()
        self._will_look = False
        """Whether the receiving thread is about to check for overdue calls."""
        self._threads = LeaderFollowers("inproc", self._receive, wake=lambda: self._work.put(_nothing))
        self._threads.start()

    @cached_property
    def codec(self) -> Codec:
        from ..wire.identity import Identity  # it needs numpy; whether this transport is there is asked without

        return Identity()

    @property
    def idle(self) -> bool:
        """Whether the sinks have handled everything that was sent to the inlets."""
        return all(link.lane.idle for link in list(self._links) if isinstance(link, _Inlet))

    def release(self, everything: contextlib.ExitStack) -> None:
        everything.callback(self._threads.close)

    def do(self, job: Job) -> None:
        """Have a thread of this transport run a job."""
        self._work.put(job)

    def look(self) -> None:
        """Have the receiving thread check for overdue calls: a new call may end before its planned wait does."""
        if not self._will_look:
            self._will_look = True
            self._work.put(_nothing)

    def _receive(self) -> Iterable[Job]:
        self._will_look = False  # before the check: later calls are seen by it or request another one
        waits = [link.pending.expire(self.do) for link in list(self._links) if isinstance(link, _Caller)]
        try:
            return (self._work.get(timeout=min([_LOOK, *(wait for wait in waits if wait is not None)])),)
        except queue.Empty:
            self.close_if_abandoned()
            return ()


def _nothing() -> None: ...


class _Outlet(BusLink[InprocTransport], SupportsSubscribers):
    sides = "outlet", "inlet"

    def __init__(self, transport: InprocTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._lossy = channel.pattern is Pattern.PUBLISH and not channel.qos.reliable
        """Whether `send` never waits for subscribers, even reliable ones."""
        self._order = threading.Lock()
        self._source, self._sent = random_id(), 0
        self._history: deque[tuple[int, int, Payload]] = deque(maxlen=channel.qos.depth if channel.qos.latched else 0)
        """The latest messages, each with its number and its time (ns since the Unix epoch)."""
        self._greeted: weakref.WeakSet[_Inlet] = weakref.WeakSet()
        """The subscribers that have got the history."""

    @property
    def has_subscribers(self) -> bool:
        """Whether there is a subscriber, or a late one may want latched messages."""
        return bool(self.peers() or self._history.maxlen)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        self.check_open()
        end = time.monotonic() + deadline
        if self.channel.pattern is Pattern.COMMAND:
            for inlet in self.peers():
                self._give(inlet, payload, end)
                return
            self.counterparts(strict=True)
            raise Unreachable(f"{self.channel.name}: no server")
        self.take_turn(self._order, deadline)
        try:
            inlets = self.peers()
            for inlet in inlets:
                self._greet(inlet)
            self._sent += 1
            if self._history.maxlen:
                self._history.append((self._sent, time.time_ns(), payload))
            for inlet in inlets:
                self._give(inlet, payload, end)
        finally:
            self._order.release()

    def greet(self, inlet: _Inlet) -> None:
        """Give a late subscriber what it missed."""
        with self._order:
            self._greet(inlet)

    def _greet(self, inlet: _Inlet) -> None:
        if self._history.maxlen and inlet.channel.qos.latched and inlet not in self._greeted:
            self._greeted.add(inlet)
            name, source = self.channel.name, self._source
            inlet.lane.start_with(
                inlet.admit(name, stamp, payload, source, number) for number, stamp, payload in self._history
            )
            inlet.have_drained()

    def _give(self, inlet: _Inlet, payload: Payload, end: float) -> None:
        if inlet.reception.on:
            payload = inlet.admit(self.channel.name, time.time_ns(), payload, self._source, self._sent)
        elif inlet.signed:
            payload = From(self.transport.sender, payload)
        patience = 0.0 if self._lossy else max(0.0, end - time.monotonic())
        if not inlet.lane.put(payload, patience, may_be_lost=self._lossy):
            raise Timeout(f"{self.channel.name}: a subscriber is too slow")
        inlet.have_drained()


class _Inlet(BusLink[InprocTransport], SupportsSources):
    sides = "inlet", "outlet"

    def __init__(self, transport: InprocTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        topic = channel.pattern is Pattern.PUBLISH
        depth = depth_of(channel.qos) if topic else COMMANDS_WAITING
        lossy = topic and not channel.qos.reliable
        self.alone = not topic
        self.signed = channel.signed and not topic  # the reception signs those of topics
        self.lane = Lane(channel.name, sink, depth, lossy=lossy, stats=self.stats)
        self.reception = Reception(channel, self.stats, self.lane.through)

    def look(self) -> bool:
        self.reception.meet(self.sources())
        return True

    def sources(self) -> list[Source]:
        return [Source(peer.channel, peer.link.channel.qos) for peer in self.counterparts()]

    def admit(self, name: str, stamp: int, payload: Payload, source: int, sequence: int) -> Payload:
        """What to put into the lane for a message of that channel."""
        return self.reception.admit(name, stamp, payload, source, sequence) if self.reception.on else payload

    def opened(self) -> None:
        if self.channel.qos.latched:
            for peer in self.counterparts():
                peer.link.greet(self)

    def have_drained(self) -> None:
        """Have a thread of this transport drain the lane, unless one is about to."""
        if self.lane.summon():
            self.transport.do(self.lane.drain)

    def release(self) -> None:
        self.lane.close()


class _Caller(BusLink[InprocTransport]):
    sides = "caller", "server"

    def __init__(self, transport: InprocTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.pending = Pending(channel.name)
        self._sequence = itertools.count(1)
        self._enough = math.inf if transport.hand_over else TRUSTED
        self._found: tuple[int, _Server] = -1, None  # type: ignore[assignment]  # of no version of the bus

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        server = self._server()
        signed = From(self.transport.sender, payload) if server.signed else payload
        future = self._start(server, signed, deadline, self._answered)
        self.transport.look()
        return future

    def ask(self, payload: Payload, deadline: float) -> Reply:
        version, server = self._found  # `_server` inlined, for speed; closing also changes the version
        if version != self.bus.version:
            server = self._server()
        if server.signed:
            payload = From(self.transport.sender, payload)
        if server.trusted >= self._enough:
            return self._ask_here(server, payload, deadline)
        # The Future has no callbacks, so any thread may end it.
        return self._outcome(self._start(server, payload, deadline, self.pending.settle), deadline, deadline)

    def _ask_here(self, server: _Server, payload: Payload, deadline: float) -> Reply:
        """Run the service on this thread."""
        reply, seconds = server.run_here(payload, deadline)
        if isinstance(reply, Reply):
            if seconds > deadline:
                raise self._late(deadline)
            return reply
        key = server, next(self._sequence)
        future = self.pending.add(key, deadline)
        if reply:
            pass_on(reply, partial(self.pending.settle, key))
        if server.closed.is_set():
            self.server_left(server)
        return self._outcome(future, deadline, max(0.0, deadline - seconds))

    def _outcome(self, future: Future[Reply], deadline: float, left: float) -> Reply:
        """Wait for the end of a call, at most `left` seconds."""
        try:
            return future.result(left)
        except FutureTimeout:
            future.cancel()
            raise self._late(deadline) from None

    def _late(self, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: no answer in {deadline:g} s")

    def _answered(self, key: Hashable, reply: Reply) -> None:
        """Called on a thread of the server, which must not run the callbacks of our Future."""
        self.transport.do(partial(self.pending.settle, key, reply))

    def _server(self) -> _Server:
        """The server of the channel. Raises Unreachable, ContractMismatch, Closed."""
        self.check_open()
        version, server = self._found
        if version == self.bus.version:
            return server
        version = self.bus.version  # before the look, so that a later change causes another one
        for peer in self.counterparts(strict=True):
            self._found = version, peer.link
            return self._found[1]
        raise Unreachable(f"{self.channel.name}: no server")

    def _start(
        self, server: _Server, payload: Payload, deadline: float, answered: Callable[[Hashable, Reply], object]
    ) -> Future[Reply]:
        key = server, next(self._sequence)
        future = self.pending.add(key, deadline)
        if not server.take(id(self), payload, time.monotonic() + deadline, partial(answered, key)):
            self.pending.settle(key, Reply(Status.BUSY))  # on this thread: the Future has no callbacks yet
        if server.closed.is_set():  # if it was closed before it had the request, it did not fail it
            self.server_left(server)
        return future

    def server_left(self, server: _Server) -> None:
        """A server was closed: fail the calls that wait for it."""
        left = Unreachable(f"{self.channel.name}: its server left")
        self.pending.fail_all(left, only=lambda key: isinstance(key, tuple) and key[0] is server, do=self.transport.do)

    def release(self) -> None:
        self.pending.close(Closed(self.channel.name))


_Asked = tuple[Payload, float, Callable[[Reply], object]]
"""A request, when it expires, and the function that takes its reply."""


class _Server(BusLink[InprocTransport]):
    """Runs its service on threads of its transport until it has proved to be prompt, then on the calling threads.

    Its transport runs at most `AT_ONCE` requests at a time. At most `QUERIES_WAITING` more wait; further ones are
    answered with BUSY. A deadline cannot interrupt a calling thread: if a trusted service takes long, its call ends
    with Timeout, but late, and the service loses its trust.
    """

    sides = "server", "caller"
    alone = True

    def __init__(self, transport: InprocTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self.signed = channel.signed
        self._servant = Servant(channel.name, service, self.stats)
        self._lock = threading.Lock()
        self._waiting: Turns[_Asked] = Turns()
        self._running = 0
        """The number of requests that threads of this transport run or are about to run."""
        self.trusted = 0
        """The number of prompt runs in a row."""

    def take(self, caller: int, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> bool:
        """Take a request, to answer it later; False if too many wait."""
        with self._lock:
            if len(self._waiting) >= QUERIES_WAITING:
                self.stats.dropped += 1
                return False
            self._waiting.add(caller, (payload, expires, answer))
            if self._running == AT_ONCE:
                return True
            self._running += 1
        self.transport.do(self._next)
        return True

    def _next(self) -> None:
        """Run one request, the callers in turn. The next one queues behind the other jobs of the transport."""
        try:
            with self._lock:
                asked = self._waiting.take() if self._waiting else None  # another thread may have taken it
            if asked:
                self._run(*asked)
        finally:
            with self._lock:
                more = bool(self._waiting)
                self._running -= not more
            if more:
                self.transport.do(self._next)

    def _run(self, payload: Payload, expires: float, answer: Callable[[Reply], object]) -> None:
        begun = time.monotonic()
        self._servant.serve(payload, expires, answer)
        prompt = time.monotonic() - begun < PROMPT and not self.transport.hand_over
        self.trusted = self.trusted + 1 if prompt else 0

    def run_here(self, payload: Payload, deadline: float) -> tuple[Reply | Future[Reply] | None, float]:
        """Run the service on the calling thread. Returns its result (None if it is closed) and the seconds it took."""
        begun = time.monotonic()
        reply = self._servant.ask(payload, begun, begun + deadline)
        seconds = time.monotonic() - begun
        if seconds >= PROMPT:
            self.trusted = 0
        return reply, seconds

    def withdraw(self) -> None:
        super().withdraw()
        for peer in self.faced():
            peer.link.server_left(self)

    def release(self) -> None:
        self._servant.close()
        with self._lock:
            self._waiting = Turns()


InprocTransport.ends = Ends(_Outlet, _Outlet, _Inlet, _Inlet, _Caller, _Server)
