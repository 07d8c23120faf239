"""Transport `inproc`: threads of one process. The reference implementation of the contract; read it first.

Transports opened on the same bus see each other. Payloads are passed on unchanged; the codec
`identity` makes them immutable values.

Changing threads twice takes ten times as long as the rest of a call. So the calling thread runs the
service itself, once the service has proved to be prompt; see `_Server`.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import queue
import threading
import time
import weakref
from collections import defaultdict, deque
from collections.abc import Callable, Hashable, Iterable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from functools import partial
from typing import TypeVar

from ..contract.interface import Pattern
from ..errors import AlreadyServed, Closed, ConfigurationError, ContractMismatch, Timeout, Unreachable
from ..wire.codec import Codec, Payload
from ..wire.identity import Identity
from ..wire.names import matches
from .base import (
    ANY_QOS,
    Channel,
    Reply,
    Service,
    Sink,
    Source,
    Statistics,
    Status,
    SupportsHeard,
    SupportsSources,
    TransportConfig,
    depth_of,
    mismatch,
    options_of,
    pass_on,
)
from .deployment import Deployment, Near
from .leader_followers import Job, Lane, LeaderFollowers, Servant, abandoned
from .limits import COMMANDS_WAITING, QUERIES_WAITING
from .pending import Pending
from .reception import Reception
from .turns import Turns

log = logging.getLogger("robocomp.transport.inproc")

L = TypeVar("L", bound="_Link")

PROMPT = 0.001
"""Maximum seconds of a service that calling threads may run."""

TRUSTED = 3
"""Prompt runs in a row, on threads of its own transport, before calling threads may run a service."""

_LOOK = 1.0
"""Seconds between two checks whether the program has ended without closing a transport."""

AT_ONCE = 64
"""Maximum number of requests to one server that threads of its transport run at the same time."""


class _Bus:
    """All links of the transports that share a bus. Its lock is never held while calling out."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.version = 0
        """Grows with every link that comes or goes."""
        self.links: list[_Link] = []

    def add(self, link: _Link) -> None:
        """Raises AlreadyServed if the link serves a channel that is served already."""
        with self.changed:
            if link.alone and any(type(other) is type(link) and other.meets(link) for other in self.links):
                raise AlreadyServed(f"{link.channel.name}: already served")
            self.links.append(link)
            self.version += 1
            faced = [other for other in self.links if isinstance(other, link.facing) and other.meets(link)]
            self.changed.notify_all()
        for other in faced:
            if all((link.compare(other), other.compare(link))):
                link.met(other)
                other.met(link)

    def moved_on(self, version: int) -> bool:
        """Whether a link has come or gone since that version."""
        return self.version != version

    def remove(self, link: _Link) -> None:
        with self.changed:
            if link in self.links:
                self.links.remove(link)
            self.version += 1
            self.changed.notify_all()


_BUSES: dict[str, _Bus] = defaultdict(_Bus)


class InprocTransport:
    """Option `bus`: the name of the bus to join. Option `hand_over`: no calling thread runs a service.

    It covers calls to this transport and calls from it.
    """

    capabilities = ANY_QOS

    def __init__(self, config: TransportConfig) -> None:
        self.codec: Codec = Identity()
        options = options_of(config, bus="default", hand_over=False)
        self.hand_over = options["hand_over"]
        if type(self.hand_over) is not bool:
            raise ConfigurationError(f"transport option `hand_over` is true or false, not {self.hand_over!r}")
        self._bus, self._owner = _BUSES[options["bus"]], config.owner or "inproc"
        self._links: list[_Link] = []
        self._closed = False
        self._work: queue.SimpleQueue[Job] = queue.SimpleQueue()
        self._will_look = False
        """Whether the receiving thread is about to check for overdue calls."""
        self._threads = LeaderFollowers("inproc", self._receive, wake=lambda: self._work.put(_nothing))
        self._threads.start()

    def outlet(self, channel: Channel) -> _Outlet:
        return self._open(_Outlet(self, self._bus, channel))

    def inlet(self, channel: Channel, sink: Sink) -> _Inlet:
        return self._open(_Inlet(self, self._bus, channel, sink))

    def caller(self, channel: Channel) -> _Caller:
        return self._open(_Caller(self, self._bus, channel))

    def server(self, channel: Channel, service: Service) -> _Server:
        return self._open(_Server(self, self._bus, channel, service))

    @property
    def idle(self) -> bool:
        """Whether the sinks have handled everything that was sent to the inlets."""
        return all(link.lane.idle for link in list(self._links) if isinstance(link, _Inlet))

    def close(self) -> None:
        self._closed = True
        with contextlib.ExitStack() as everything:
            everything.callback(self._threads.close)
            for link in list(self._links):
                everything.callback(link.close)

    def do(self, job: Job) -> None:
        """Have a thread of this transport run a job."""
        self._work.put(job)

    def look(self) -> None:
        """Have the receiving thread check for overdue calls: a new call may end before its planned wait does."""
        if not self._will_look:
            self._will_look = True
            self._work.put(_nothing)

    def left(self, link: _Link) -> None:
        with contextlib.suppress(ValueError):  # closed a second time
            self._links.remove(link)

    def _receive(self) -> Iterable[Job]:
        self._will_look = False  # before the check: later calls are seen by it or request another one
        waits = [link.pending.expire(self.do) for link in list(self._links) if isinstance(link, _Caller)]
        try:
            return (self._work.get(timeout=min([_LOOK, *(wait for wait in waits if wait is not None)])),)
        except queue.Empty:
            if abandoned():
                log.warning("%s: not closed at the end of the program; closing", self._owner)
                self.close()
            return ()

    def _open(self, link: L) -> L:
        if self._closed:
            raise Closed("the transport is closed")
        self._bus.add(link)
        self._links.append(link)
        try:
            link.opened()
            if self._closed:
                raise Closed("the transport is closed")
        except BaseException:
            link.close()
            raise
        return link


def _nothing() -> None: ...


class _Link:
    """One end of a channel; `facing` is the class of the other end."""

    facing: type[_Link]
    alone = False
    """Whether a channel may have only one such link."""

    def __init__(self, transport: InprocTransport, bus: _Bus, channel: Channel) -> None:
        self.transport, self.channel = transport, channel
        self.stats = Statistics()
        self.closed = False
        self._bus = bus
        self._reported: set[int] = set()

    def opened(self) -> None: ...

    def met(self, other: _Link) -> None:
        """A peer with the same contract has come."""

    def peers(self) -> list[_Link]:
        """The peers with the same contract. Raises ContractMismatch if there are only others."""
        with self._bus.changed:
            named = [other for other in self._bus.links if isinstance(other, self.facing) and self.meets(other)]
        same = [other for other in named if self.compare(other)]
        if named and not same:
            raise ContractMismatch(mismatch(self.channel, named[0].channel.type))
        return same

    def peers_or_none(self) -> list[_Link]:
        try:
            return self.peers()
        except ContractMismatch:
            return []

    def wait_peer(self, timeout: float) -> bool:
        deadline = time.monotonic() + timeout
        while True:
            self.check_open()
            seen = self._bus.version  # before the look, so that a peer that comes meanwhile is noticed
            if self.peers():
                return True
            left = max(0.0, deadline - time.monotonic())
            with self._bus.changed:
                if not self._bus.changed.wait_for(partial(self._bus.moved_on, seen), left):
                    return False

    def close(self) -> None:
        self.closed = True
        self._bus.remove(self)
        self.transport.left(self)

    def check_open(self) -> None:
        if self.closed:
            raise Closed(self.channel.name)

    def meets(self, other: _Link) -> bool:
        """Whether the other end has a matching channel. With `*`, links of the same transport do not match."""
        mine, theirs = self.channel, other.channel
        same_name = matches(mine.name, theirs.name) or matches(theirs.name, mine.name)
        itself = self.transport is other.transport and mine.name != theirs.name
        return same_name and not itself and mine.pattern is theirs.pattern and not other.closed

    def compare(self, other: _Link) -> bool:
        """Whether the other end has the same contract; if not, that is reported once."""
        same = self.channel.type.fingerprint == other.channel.type.fingerprint
        if not same and id(other) not in self._reported:
            self._reported.add(id(other))
            log.error("%s", mismatch(self.channel, other.channel.type))
            self.stats.mismatched += 1
        return same


class _Outlet(_Link, SupportsHeard):
    def __init__(self, transport: InprocTransport, bus: _Bus, channel: Channel) -> None:
        super().__init__(transport, bus, channel)
        self._lossy = channel.pattern is Pattern.PUBLISH and not channel.qos.reliable
        """Whether `send` never waits for subscribers, even reliable ones."""
        self._order = threading.Lock()
        self._looked = -1, False
        self._history: deque[tuple[int, Payload]] = deque(maxlen=channel.qos.depth if channel.qos.latched else 0)
        """The latest messages, each with its time (ns since the Unix epoch)."""
        self._greeted: weakref.WeakSet[_Inlet] = weakref.WeakSet()
        """The subscribers that have got the history."""

    @property
    def heard(self) -> bool:
        """Whether there is a subscriber, or a late one may want latched messages."""
        if self._looked[0] != self._bus.version:
            self._looked = self._bus.version, bool(self.peers_or_none())
        return self._looked[1] or bool(self._history.maxlen)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        self.check_open()
        end = time.monotonic() + deadline
        if self.channel.pattern is Pattern.COMMAND:
            server = next(iter(self.peers()), None)
            if server is None:
                raise Unreachable(f"{self.channel.name}: no server")
            self._give(server, payload, end)
            return
        if not self._order.acquire(timeout=max(0.0, deadline)):
            raise Timeout(f"{self.channel.name}: another thread was still sending after {deadline:g} s")
        try:
            inlets = self.peers_or_none()
            for inlet in inlets:
                self._greet(inlet)
            if self._history.maxlen:
                self._history.append((time.time_ns(), payload))
            for inlet in inlets:
                self._give(inlet, payload, end)
        finally:
            self._order.release()

    def greet(self, inlet: _Inlet) -> None:
        """Give a late subscriber what it missed."""
        with self._order:
            self._greet(inlet)

    def _greet(self, inlet: _Link) -> None:
        assert isinstance(inlet, _Inlet)
        if self._history.maxlen and inlet.channel.qos.latched and inlet not in self._greeted:
            self._greeted.add(inlet)
            inlet.lane.start_with(inlet.admit(self.channel.name, stamp, payload) for stamp, payload in self._history)
            inlet.have_drained()

    def _give(self, inlet: _Link, payload: Payload, end: float) -> None:
        assert isinstance(inlet, _Inlet)
        if inlet.reception.on:
            payload = inlet.admit(self.channel.name, time.time_ns(), payload)
        patience = 0.0 if self._lossy else max(0.0, end - time.monotonic())
        if not inlet.lane.put(payload, patience, may_be_lost=self._lossy):
            raise Timeout(f"{self.channel.name}: a subscriber is too slow")
        inlet.have_drained()


class _Inlet(_Link, SupportsSources):
    facing = _Outlet

    def __init__(self, transport: InprocTransport, bus: _Bus, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, bus, channel)
        topic = channel.pattern is Pattern.PUBLISH
        depth = depth_of(channel.qos) if topic else COMMANDS_WAITING
        lossy = topic and not channel.qos.reliable
        self.alone = not topic
        self.lane = Lane(channel.name, sink, depth, lossy=lossy, stats=self.stats)
        self.reception = Reception(channel, self.stats, self.lane.through)

    def met(self, other: _Link) -> None:
        self.reception.meet([Source(other.channel.name, other.channel.qos)])

    def sources(self) -> list[Source]:
        return [Source(outlet.channel.name, outlet.channel.qos) for outlet in self.peers_or_none()]

    def admit(self, name: str, stamp: int, payload: Payload) -> Payload:
        """What to put into the lane for a message of that channel."""
        return self.reception.admit(name, stamp, payload) if self.reception.on else payload

    def opened(self) -> None:
        if self.channel.qos.latched:
            for outlet in self.peers_or_none():
                assert isinstance(outlet, _Outlet)
                outlet.greet(self)

    def have_drained(self) -> None:
        """Have a thread of this transport drain the lane, unless one is about to."""
        if self.lane.summon():
            self.transport.do(self.lane.drain)

    def close(self) -> None:
        super().close()
        self.lane.close()


_Outlet.facing = _Inlet


class _Caller(_Link):
    def __init__(self, transport: InprocTransport, bus: _Bus, channel: Channel) -> None:
        super().__init__(transport, bus, channel)
        self.pending = Pending(channel.name)
        self._sequence = itertools.count(1)
        self._enough = float("inf") if transport.hand_over else TRUSTED
        self._found: tuple[int, _Server] = -1, None  # type: ignore[assignment]  # of no version of the bus

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        future = self._start(self._server(), payload, deadline, self._answered)
        self.transport.look()
        return future

    def ask(self, payload: Payload, deadline: float) -> Reply:
        version, server = self._found  # `_server` inlined, for speed; closing also changes the version
        if version != self._bus.version:
            server = self._server()
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
        if server.closed:
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
        if version == self._bus.version:
            return server
        version = self._bus.version  # before the look, so that a later change causes another one
        found = next(iter(self.peers()), None)
        if found is None:
            raise Unreachable(f"{self.channel.name}: no server")
        assert isinstance(found, _Server)
        self._found = version, found
        return found

    def _start(
        self, server: _Server, payload: Payload, deadline: float, answered: Callable[[Hashable, Reply], object]
    ) -> Future[Reply]:
        key = server, next(self._sequence)
        future = self.pending.add(key, deadline)
        if not server.take(id(self), payload, time.monotonic() + deadline, partial(answered, key)):
            self.pending.settle(key, Reply(Status.BUSY))  # on this thread: the Future has no callbacks yet
        if server.closed:  # if it was closed before it had the request, it did not fail it
            self.server_left(server)
        return future

    def server_left(self, server: _Server) -> None:
        """A server was closed: fail the calls that wait for it."""
        left = Unreachable(f"{self.channel.name}: its server left")
        self.pending.fail_all(left, only=lambda key: isinstance(key, tuple) and key[0] is server, do=self.transport.do)

    def close(self) -> None:
        super().close()
        self.pending.close(Closed(self.channel.name))


_Asked = tuple[Payload, float, Callable[[Reply], object]]
"""A request, when it expires, and the function that takes its reply."""


class _Server(_Link):
    """Runs its service on threads of its transport until it has proved to be prompt, then on the calling threads.

    Its transport runs at most `AT_ONCE` requests at a time. At most `QUERIES_WAITING` more wait; further ones are
    answered with BUSY. A deadline cannot interrupt a calling thread: if a trusted service takes long, its call ends
    with Timeout, but late, and the service loses its trust.
    """

    facing = _Caller
    alone = True

    def __init__(self, transport: InprocTransport, bus: _Bus, channel: Channel, service: Service) -> None:
        super().__init__(transport, bus, channel)
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

    def close(self) -> None:
        callers = [link for link in self.peers_or_none() if isinstance(link, _Caller)]
        super().close()
        for caller in callers:
            caller.server_left(self)
        self._servant.close()
        with self._lock:
            self._waiting = Turns()


_Caller.facing = _Server


class InprocDeployment(Deployment):
    summary = "objects, between components of one process"
    colour = "#6b7280"
    near = Near.PROCESS
    unprotected = ""  # one process
    shares = False
