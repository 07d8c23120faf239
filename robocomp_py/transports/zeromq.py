"""Transport `zeromq`: a socket for every topic that is published, one for all operations that are served.

    frames of a publication   channel · header · payload…            XPUB → SUB
    frames of a request       channel · header · payload…            DEALER → ROUTER
    frames of a reply         header · payload…                      ROUTER → DEALER

Who serves what, and where, stands in the directory of the run-time folder, beside the sockets'
`ipc://` files. A late subscriber of a latched topic also subscribes to a name of its own, and gets
under it what it missed.

Threads. A ZeroMQ socket may be used by several threads only under a lock, and nobody must sleep
holding it. So one thread (the leader of a `Crew`) sleeps on the file descriptors of all sockets,
and everybody reads and writes under the socket's lock without waiting (`_Socket`). The exception
is a synchronous call: its thread takes a socket out of a pool, has it to itself, and receives the
answer itself.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import zmq

from ..contract.interface import Pattern
from ..contract.qos import History
from ..errors import (
    AlreadyServed,
    Closed,
    ConfigurationError,
    ContractMismatch,
    DecodeError,
    Timeout,
    TransportError,
    Unreachable,
)
from ..wire.codec import MAX_BYTES, Codec, Payload
from ..wire.header import (
    NO_DEADLINE,
    Flag,
    ReplyHeader,
    Request,
    pack_publication,
    pack_reply,
    pack_request,
    random_id,
    read_publication,
    read_reply,
    read_request,
)
from ..wire.messagepack import MessagePack
from .base import (
    Capability,
    Channel,
    Reply,
    Service,
    Sink,
    Statistics,
    Status,
    TransportConfig,
    TypeRef,
    mismatch,
    options_of,
    serve,
)
from .crew import Crew, Gate, Job, Lane
from .directory import Directory, Entry, Member, runtime_dir
from .exclusive import Claim, claim
from .ledger import Ledger
from .pending import Pending

log = logging.getLogger("robocomp.transport.zeromq")

TICK = 0.05
"""Seconds between two looks into the directory, and at those we wait for."""

LINGER_MS = 500
"""How long closing may wait for what was sent last to leave."""

BATCH = 32
"""Messages taken from one socket before the others have their turn."""

LONGEST_PAUSE = 0.005
"""Seconds between two attempts to send, when there is no room."""

KEEP_ALL_DEPTH = 10_000
COMMANDS_WAITING = 1000

Frames = list[Any]
L = TypeVar("L", bound="_Link")
T = TypeVar("T")


class ZeroMQTransport:
    """Option `bind`: TCP address at which operations are served as well, `tcp://127.0.0.1:5555`."""

    capabilities = Capability.RELIABLE | Capability.LATCHED | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        self._bind = options_of(config, bind="")["bind"]
        self.codec: Codec = MessagePack()
        self.incarnation = random_id()
        self.owner, self.folder = config.owner, _short_enough(runtime_dir() / "zeromq")
        self.closed = False
        self._lock = threading.RLock()
        self._links: list[_Link] = []
        self._peers: dict[str, _Peer] = {}
        self._router: _Router | None = None
        self._known = -1
        """The version of the directory that all links have seen."""
        self._last: dict[object, str] = {}
        """What last went wrong on the receiving thread, so that it is not told at every tick."""
        self.directory = Directory(self.folder)
        self.member = self.directory.join(config.owner)
        try:
            self._loop = _Loop(self._tick)
        except OSError as exc:
            self.member.close()
            raise TransportError(f"zeromq: cannot be opened: {exc.strerror}") from exc
        self.context = zmq.Context()
        self._crew = Crew("zeromq", self._loop.receive, self._loop.wake)
        self._crew.start()

    def outlet(self, channel: Channel) -> _Publisher | _CommandOutlet:
        kind = _Publisher if channel.pattern is Pattern.PUBLISH else _CommandOutlet
        return self._open(kind(self, channel))

    def inlet(self, channel: Channel, sink: Sink) -> _Subscriber | _CommandInlet:
        kind = _Subscriber if channel.pattern is Pattern.PUBLISH else _CommandInlet
        return self._open(kind(self, channel, sink))

    def caller(self, channel: Channel) -> _Caller:
        return self._open(_Caller(self, channel))

    def server(self, channel: Channel, service: Service) -> _Server:
        return self._open(_Server(self, channel, service))

    def close(self) -> None:
        with self._lock:
            if self.closed:
                return
            self.closed = True
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            everything.callback(self._loop.close)
            everything.callback(self.context.term)
            everything.callback(self._close_sockets)
            everything.callback(self._crew.close)
            everything.callback(self.member.close)
            for link in list(self._links):
                everything.callback(link.close)

    def _close_sockets(self) -> None:
        with self._lock:
            peers = list(self._peers.values())
        with contextlib.ExitStack() as everything:
            for socket in self._loop.sockets():  # the router's, and those of links that could not be closed
                everything.callback(socket.close)
            for peer in peers:
                everything.callback(peer.close)

    # What links use.

    def socket(self, kind: int, on_input: Callable[[_Socket], list[Job]], **options: int) -> _Socket:
        """A shared socket, whose input the crew attends to from now on."""
        socket = _Socket(new_socket(self.context, kind, **options), on_input, self._loop.attend)
        self._loop.add(socket)
        return socket

    def forget(self, socket: _Socket) -> None:
        self._loop.remove(socket)
        socket.close()

    def attend(self, socket: _Socket) -> None:
        self._loop.attend(socket)

    def wake(self) -> None:
        self._loop.wake()

    def do(self, job: Job) -> None:
        """Have the crew run this."""
        self._loop.do(job)

    def router(self) -> _Router:
        with self._lock:
            if self._router is None:
                self._router = _Router(self, self._bind)
            return self._router

    def peer(self, member: Member, address: str) -> _Peer:
        with self._lock:
            if self.closed:
                raise Closed("the transport is closed")
            if member.id not in self._peers:
                self._peers[member.id] = _Peer(self, member.id, address)
            return self._peers[member.id]

    def drop(self, peer: _Peer) -> None:
        """Its process is dead: nobody we wait for there will answer."""
        with self._lock:
            self._peers.pop(peer.id, None)
        peer.close()

    def left(self, link: _Link) -> None:
        with self._lock:
            if link in self._links:
                self._links.remove(link)
            for work in (link.look, link.tick):
                self._last.pop(work, None)

    def _guarded(self, work: Callable[[], T], otherwise: T) -> T:
        """What a link does on the thread that receives for everybody: if it fails, the others go on."""
        try:
            result = work()
        except Exception as exc:
            if self._last.get(work) != repr(exc):
                self._last[work] = repr(exc)
                log.exception("looking after a link; trying again")
            return otherwise
        self._last.pop(work, None)
        return result

    def _open(self, link: L) -> L:
        if self.closed:
            raise Closed("the transport is closed")
        try:
            link.open()
        except BaseException:
            link.close()
            raise
        with self._lock:
            self._links.append(link)  # only now: those in the list are looked after by the receiving thread
            closed = self.closed
        if closed:
            link.close()
            raise Closed("the transport is closed")
        if not self._guarded(link.look, False):  # who came after it was opened, and before it was in the list
            self._known = -1
        return link

    def _tick(self) -> float:
        """Do what is due; seconds until the next time."""
        version = self.directory.version()
        links = list(self._links)
        if version != self._known and all([self._guarded(link.look, False) for link in links]):
            self._known = version
        waits = [self._guarded(link.tick, None) for link in links]
        return min([TICK, *(wait for wait in waits if wait is not None)])


def _short_enough(folder: Path) -> Path:
    """The folder, if the paths of sockets in it are not too long for the kernel."""
    longest = len(os.fsencode(folder / "4194304-01234567-router"))
    if longest > 107:
        raise ConfigurationError(
            f"run-time folder {folder}: paths of sockets in it would have {longest} bytes, and 107 is the limit; "
            "set ROBOCOMP_RUNTIME_DIR to a shorter path"
        )
    return folder


def new_socket(context: zmq.Context[Any], kind: int, **options: int) -> zmq.Socket[Any]:
    with as_transport_error("opening a socket"):
        socket: zmq.Socket[Any] = context.socket(kind)
        settings = {"LINGER": LINGER_MS, "MAXMSGSIZE": MAX_BYTES + 65536, "HANDSHAKE_IVL": 2000} | options
        for name, value in settings.items():
            socket.setsockopt(getattr(zmq, name), value)
        return socket


@contextlib.contextmanager
def as_transport_error(doing: str) -> Iterator[None]:
    try:
        yield
    except zmq.ZMQError as exc:
        raise TransportError(f"zeromq: {doing}: {exc}") from exc


def send_frames(socket: zmq.Socket[Any], frames: Frames, flags: int = 0) -> None:
    """What `send_multipart` does, in half the time."""
    for frame in frames[:-1]:
        socket.send(frame, flags | zmq.SNDMORE)
    socket.send(frames[-1], flags)


def receive_frames(socket: zmq.Socket[Any], flags: int = 0) -> Frames:
    """What `recv_multipart` does, in half the time."""
    frames: Frames = [socket.recv(flags)]
    while socket.get(zmq.RCVMORE):
        frames.append(socket.recv(flags))
    return frames


class _Socket:
    """A ZeroMQ socket that several threads may use, because nothing here waits.

    Its file descriptor tells of input only once, and any use of the socket may swallow that; so
    whoever used it looks whether there is some, and has it attended to.
    """

    def __init__(
        self, raw: zmq.Socket[Any], on_input: Callable[[_Socket], list[Job]], attend: Callable[[_Socket], None]
    ) -> None:
        self.lock = threading.RLock()
        self.fileno = int(raw.FD)
        self.raw = raw
        self.closed = False
        self.awaited = False
        """Whether it will be looked at anyway."""
        self.on_input = on_input
        self._attend = attend

    def send(self, frames: Frames) -> bool:
        """Whether it was sent; if not, there is no room now, or nobody is connected."""
        with self.lock:
            if self.closed:
                return False
            try:
                send_frames(self.raw, frames, zmq.NOBLOCK)
                sent = True
            except zmq.Again:
                sent = False
            if not self.awaited and int(self.raw.get(zmq.EVENTS)) & zmq.POLLIN:
                self._attend(self)
            return sent

    def receive(self) -> Frames | None:
        with self.lock:
            if self.closed:
                return None
            try:
                return receive_frames(self.raw, zmq.NOBLOCK)
            except zmq.Again:
                return None

    def close(self) -> None:
        with self.lock:
            if not self.closed:
                self.closed = True
                self.raw.close()


def persist(send: Callable[[], bool], end: float, still: Callable[[], None], closed: threading.Event) -> bool:
    """Try to send until `end`; `still` is called meanwhile, and may raise.

    A socket cannot be asked when there will be room: others use it, and a publisher's always claims to
    have some.
    """
    pause = 0.0001
    while not send():
        left = end - time.monotonic()
        if left <= 0:
            return False
        still()
        closed.wait(min(pause, left))
        pause = min(2 * pause, LONGEST_PAUSE)
    return True


class _Loop:
    """Waits for input on all sockets at once, and for what is due. `receive` is for one thread at a time."""

    def __init__(self, tick: Callable[[], float]) -> None:
        self._tick = tick
        self._poller = select.poll()
        self._sockets: dict[int, _Socket] = {}
        self._ready: deque[_Socket] = deque()
        self._jobs: deque[Job] = deque()
        self._next_tick = 0.0
        self._sleeping = False
        self._closed = False
        self._pipe = threading.Lock()
        self._wake_out, self._wake_in = os.pipe()
        os.set_blocking(self._wake_out, False)
        os.set_blocking(self._wake_in, False)
        self._poller.register(self._wake_out, select.POLLIN)

    def add(self, socket: _Socket) -> None:
        self._sockets[socket.fileno] = socket
        self._poller.register(socket.fileno, select.POLLIN)
        self.attend(socket)

    def remove(self, socket: _Socket) -> None:
        if self._sockets.get(socket.fileno) is socket:
            del self._sockets[socket.fileno]
            self._poller.unregister(socket.fileno)
        self.wake()

    def sockets(self) -> list[_Socket]:
        return list(self._sockets.values())

    def attend(self, socket: _Socket) -> None:
        """Look at this socket next, whatever its file descriptor says."""
        socket.awaited = True
        self._ready.append(socket)
        if self._sleeping:
            self._interrupt()

    def do(self, job: Job) -> None:
        """Return this job next."""
        self._jobs.append(job)
        if self._sleeping:
            self._interrupt()

    def wake(self) -> None:
        """Tick now: something became due earlier, or a socket came or went."""
        self._next_tick = 0.0
        self._interrupt()

    def receive(self) -> list[Job]:
        if time.monotonic() >= self._next_tick:
            self._next_tick = time.monotonic() + self._tick()
        self._sleeping = True  # before looking at what is ready: whoever adds to it later sees this, and interrupts
        timeout = 0.0 if self._ready or self._jobs else max(0.0, self._next_tick - time.monotonic())
        events = self._poller.poll(timeout * 1000)
        self._sleeping = False
        for descriptor, _ in events:
            if descriptor == self._wake_out:
                with contextlib.suppress(BlockingIOError):
                    os.read(self._wake_out, 4096)
            elif descriptor in self._sockets:
                self._ready.append(self._sockets[descriptor])
        for _ in range(len(self._ready)):
            socket = self._ready.popleft()
            socket.awaited = False
            try:
                self._jobs.extend(socket.on_input(socket))
            except Exception:
                log.exception("taking input")  # of one socket; the others have theirs taken
        return [self._jobs.popleft() for _ in range(len(self._jobs))]

    def close(self) -> None:
        with self._pipe:
            self._closed = True
            os.close(self._wake_out)
            os.close(self._wake_in)

    def _interrupt(self) -> None:
        with self._pipe:  # a handler that is stuck may come here after we were closed
            if not self._closed:
                with contextlib.suppress(BlockingIOError):  # the pipe is full, so it will wake
                    os.write(self._wake_in, b"!")


class _Link:
    """One end of a channel: announced in the directory, and looking there for those it faces."""

    role: str
    facing: str

    def __init__(self, transport: ZeroMQTransport, channel: Channel) -> None:
        self.transport, self.channel = transport, channel
        self.stats = Statistics()
        self.closed = threading.Event()
        self._closing = threading.Lock()
        self._entry: Entry | None = None
        self._reported: set[object] = set()

    def open(self) -> None:
        self.announce()

    def tick(self) -> float | None:
        """Do what is due; seconds until the next time, if not a tick."""
        return None

    def look(self) -> bool:
        """The directory has changed. True, or it raises: whoever calls this wants to know that it was done."""
        self.counterparts()
        return True

    def wait_peer(self, timeout: float) -> bool:
        end = time.monotonic() + timeout
        while True:
            self.check_open()
            if self.visible():
                return True
            if time.monotonic() >= end:
                return False
            self.closed.wait(min(0.005, max(0.0, end - time.monotonic())))

    def visible(self) -> bool:
        """Whether the other side is there. Raises ContractMismatch if only others are."""
        return any(self.transport.directory.alive(member.id) for member, _ in self.counterparts(strict=True))

    def close(self) -> None:
        with self._closing:
            if self.closed.is_set():
                return
            self.closed.set()
        with contextlib.ExitStack() as everything:
            everything.callback(self.release)
            everything.callback(self.transport.left, self)
            if self._entry:
                everything.callback(self.transport.member.remove, self._entry)

    def release(self) -> None:
        """Let go of what this link holds, which is not everything if it could not be opened; called once."""

    def announce(self, address: str = "") -> None:
        kind = self.channel.type
        self._entry = Entry(self.role, self.channel.name, kind.fingerprint, kind.text, address)
        self.transport.member.add(self._entry)

    def counterparts(self, *, strict: bool = False) -> list[tuple[Member, Entry]]:
        """Those we face who mean the same by the name; the others are reported, once each.

        With `strict`, raises ContractMismatch if there are only others.
        """
        named = [
            (member, entry)
            for member, entry in self.transport.directory.find(self.facing, self.channel.name)
            if entry.channel == self.channel.name or member.id != self.transport.member.id
        ]
        same = [found for found in named if found[1].fingerprint == self.channel.type.fingerprint]
        for member, entry in named:
            if entry.fingerprint != self.channel.type.fingerprint:
                self.report_mismatch((member.id, entry.fingerprint), TypeRef("", entry.fingerprint, entry.text))
        if strict and named and not same:
            entry = named[0][1]
            raise ContractMismatch(mismatch(self.channel, TypeRef("", entry.fingerprint, entry.text)))
        return same

    def check_open(self) -> None:
        if self.closed.is_set() or self.transport.closed:
            raise Closed(f"{self.channel.name}: the link is closed")

    def report_mismatch(self, who: object, other: TypeRef) -> None:
        if who not in self._reported:
            self._reported.add(who)
            log.error("%s", mismatch(self.channel, other))
            self.stats.mismatched += 1

    def malformed(self, why: object) -> None:
        """Count a message that is none of ours; the first one is logged."""
        if self.stats.malformed == 0:
            log.warning("%s: dropped a malformed message (further ones are only counted): %s", self.channel.name, why)
        self.stats.malformed += 1


# -- topics -------------------------------------------------------------------


class _Publisher(_Link):
    role, facing = "publishes", "subscribes"
    _socket: _Socket | None = None

    def open(self) -> None:
        qos = self.channel.qos
        depth = KEEP_ALL_DEPTH if qos.history is History.KEEP_ALL else max(qos.depth, 8)
        self._name = self.channel.name.encode()
        self._source, self._sequence = random_id(), itertools.count(1)
        self._history: deque[Frames] = deque(maxlen=qos.depth if qos.latched else 0)
        self._subscribers = 0
        self._order = threading.Lock()
        self._socket = self.transport.socket(
            zmq.XPUB, self._on_subscription, SNDHWM=depth, XPUB_VERBOSER=1, XPUB_NODROP=int(qos.reliable)
        )
        path = self.transport.member.address(f"{self._source & 0xFFFFFF:06x}")
        with as_transport_error(f"binding {path}"), self._socket.lock:
            self._socket.raw.bind(f"ipc://{path}")
        self.announce(f"ipc://{path}")

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        if not self._order.acquire(timeout=max(0.0, deadline)):
            raise Timeout(f"{self.channel.name}: another thread was still sending after {deadline:g} s")
        try:
            self.check_open()
            header = pack_publication(self.channel.type.fingerprint, self._source, next(self._sequence), time.time_ns())
            frames = [self._name, header, *payload]
            with as_transport_error(f"publishing {self.channel.name}"):
                sent = self._send(frames) or persist(partial(self._send, frames), end, self.check_open, self.closed)
            if not sent:
                self.check_open()
                raise Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")
        finally:
            self._order.release()

    def visible(self) -> bool:
        self.counterparts(strict=True)
        return self._subscribers > 0

    def release(self) -> None:
        if self._socket:
            self.transport.forget(self._socket)

    def _send(self, frames: Frames) -> bool:
        assert self._socket
        if not self._history.maxlen:
            return self._socket.send(frames)
        with self._socket.lock:  # in one go: a subscriber that comes now gets this one as news or as history
            self._on_subscription(self._socket)
            sent = self._socket.send(frames)
            if sent:
                self._history.append([frames[1], *map(bytes, frames[2:])])
            return sent

    def _on_subscription(self, socket: _Socket) -> list[Job]:
        with socket.lock:
            while (frames := socket.receive()) is not None:
                begins, topic = frames[0][:1] == b"\1", frames[0][1:]
                if topic == self._name:
                    self._subscribers += 1 if begins else -1
                elif begins and topic[:1] == b"\0":
                    for message in self._history:
                        socket.send([topic, *message])
        return []


class _Subscriber(_Link):
    role, facing = "subscribes", "publishes"
    _socket: _Socket | None = None

    def __init__(self, transport: ZeroMQTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        qos = channel.qos
        self._depth = KEEP_ALL_DEPTH if qos.history is History.KEEP_ALL else qos.depth
        self._lane = Lane(channel.name, sink, self._depth, lossy=not qos.reliable, stats=self.stats)
        self._ledger = Ledger(self.stats, ordered=True)
        self._connected: dict[str, str] = {}
        self._paused = False

    def open(self) -> None:
        self._socket = self.transport.socket(zmq.SUB, self._on_message, RCVHWM=max(self._depth, 8), RECONNECT_IVL=-1)
        self.look()
        self.announce()

    def look(self) -> bool:
        assert self._socket
        with self._socket.lock:  # also while looking: of two who look, the later one must not connect the earlier
            there = {entry.address: entry.channel for _, entry in self.counterparts()}
            if self._socket.closed:
                return True
            for address in self._connected.keys() - there.keys():
                del self._connected[address]
                with contextlib.suppress(zmq.ZMQError):  # it has gone, and its endpoint with it
                    self._socket.raw.disconnect(address)
            for address in there.keys() - self._connected.keys():
                with as_transport_error(f"connecting to {address}"):
                    self._socket.raw.subscribe(there[address].encode())
                    if self.channel.qos.latched:
                        self._socket.raw.subscribe(b"\0" + random_id().to_bytes(8, "little"))
                    self._socket.raw.connect(address)
                self._connected[address] = there[address]
        self.transport.attend(self._socket)
        return True

    def visible(self) -> bool:
        publishers = self.counterparts(strict=True)
        return any(e.address in self._connected and self.transport.directory.alive(m.id) for m, e in publishers)

    def release(self) -> None:
        try:
            self._lane.close()
        finally:
            if self._socket:
                self.transport.forget(self._socket)

    def _on_message(self, socket: _Socket) -> list[Job]:
        taken = 0
        for _ in range(BATCH):
            self._paused = True  # before looking: whoever makes room later sees this, and has us go on
            self._paused = self._lane.full
            frames = None if self._paused else socket.receive()
            if frames is None:
                break
            taken += self._take(frames)
        else:
            self.transport.attend(socket)
        return [self._drain] if taken else []

    def _take(self, frames: Frames) -> bool:
        try:
            header = read_publication(frames[1] if len(frames) > 1 else b"")
        except DecodeError as exc:
            self.malformed(exc)
            return False
        if header.fingerprint != self.channel.type.fingerprint:
            self.report_mismatch(header.source, TypeRef("", header.fingerprint))
            return False
        return self._ledger.admit(header.source, header.sequence) and self._lane.put(frames[2:])

    def _drain(self) -> None:
        self._lane.drain()
        if self._paused and self._socket:
            self.transport.attend(self._socket)


# -- commands and queries, the asking side ------------------------------------


_TO_SERVER = {"IMMEDIATE": 1, "RECONNECT_IVL": -1, "SNDHWM": 1000, "RCVHWM": 1000}
"""No queueing for the dead; a server that comes back has another address."""


class _Peer:
    """The process behind an address: a shared line to it, and sockets for synchronous calls."""

    def __init__(self, transport: ZeroMQTransport, member_id: str, address: str) -> None:
        self.id, self._address, self._transport = member_id, address, transport
        self.closed = False
        self.callers: dict[int, _Caller] = {}
        self._lock = threading.Lock()
        self._idle: list[zmq.Socket[bytes]] = []
        self.line = transport.socket(zmq.DEALER, self._on_reply, **_TO_SERVER)
        with as_transport_error(f"connecting to {address}"), self.line.lock:
            self.line.raw.connect(address)

    def alive(self) -> bool:
        return not self.closed and self._transport.directory.alive(self.id)

    def take(self) -> zmq.Socket[bytes]:
        """A socket for the calling thread alone; it must `give` it back."""
        with self._lock:
            if self.closed:
                raise Unreachable(f"{self._address}: its server left")
            if self._idle:
                return self._idle.pop()
        options = _TO_SERVER | {"SNDTIMEO": _SLICE_MS, "RCVTIMEO": _SLICE_MS}
        socket = new_socket(self._transport.context, zmq.DEALER, **options)
        try:
            with as_transport_error(f"connecting to {self._address}"):
                socket.connect(self._address)
        except TransportError:
            socket.close()
            raise
        return socket

    def give(self, socket: zmq.Socket[bytes]) -> None:
        with self._lock:
            if not self.closed:
                self._idle.append(socket)
                return
        socket.close()

    def close(self) -> None:
        with self._lock:
            self.closed = True
            idle, self._idle = self._idle, []
        for socket in idle:
            socket.close()
        self._transport.forget(self.line)

    def _on_reply(self, socket: _Socket) -> list[Job]:
        jobs: list[Job] = []  # since the callbacks of a Future may take long, or ask again
        while (frames := socket.receive()) is not None:
            try:
                header = read_reply(frames[0])
            except DecodeError as exc:
                log.warning("%s: dropped a malformed reply: %s", self._address, exc)
                continue
            caller = self.callers.get(header.client)
            if caller:
                jobs.append(partial(caller.answered, self, header, frames[1:]))
        return jobs


_SLICE_MS = 50
"""A call that waits looks this often whether its server lives and its own link is open."""


class _AskingLink(_Link):
    """A link that finds the one process that serves its channel."""

    def __init__(self, transport: ZeroMQTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.client, self._sequence = random_id(), itertools.count(1)
        self._found: tuple[_Peer, bytes] | None = None
        self._found_at = -1
        """The version of the directory in which it was found."""

    def visible(self) -> bool:
        try:
            peer, _ = self.server(fresh=True)
            self.still(peer)
        except Unreachable:
            return False
        return True

    def server(self, *, fresh: bool = False) -> tuple[_Peer, bytes]:
        """The peer that serves this channel, and the channel's name there. Raises Unreachable.

        It may have stopped doing so since the directory was looked into, unless `fresh`.
        """
        found = self._found
        if found and not found[0].closed and not (fresh and self.transport.directory.version() != self._found_at):
            return found
        self.check_open()
        version = self.transport.directory.version()
        self._found = None
        for member, entry in self.counterparts(strict=True):
            if self.transport.directory.alive(member.id):
                found = self.transport.peer(member, entry.address), entry.channel.encode()
                self.met(found[0])
                self._found, self._found_at = found, version
                return found
        raise Unreachable(f"{self.channel.name}: nobody serves it")

    def look(self) -> bool:
        there = [(member.id, entry.channel.encode()) for member, entry in self.counterparts()]
        found = self._found
        if found and (found[0].id, found[1]) not in there:
            self._found = None
        return True

    def lost(self, peer: _Peer) -> bool:
        """Whether a peer has stopped serving this channel, as one that refuses a request probably has."""
        self.look()
        return not (self._found and self._found[0] is peer)

    def met(self, peer: _Peer) -> None:
        """A server was found."""

    def still(self, peer: _Peer) -> None:
        """Raise if there is no point in waiting any longer."""
        self.check_open()
        if not peer.alive():
            self.transport.drop(peer)
            raise Unreachable(f"{self.channel.name}: its server left")

    def request(self, channel: bytes, flags: int, remaining: float, payload: Payload) -> tuple[int, Frames]:
        number = next(self._sequence)
        header = pack_request(flags, self.channel.type.fingerprint, self.client, number, remaining)
        return number, [channel, header, *payload]


class _CommandOutlet(_AskingLink):
    role, facing = "commands", "receives"

    def __init__(self, transport: ZeroMQTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._order = threading.Lock()

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        if not self._order.acquire(timeout=max(0.0, deadline)):
            raise Timeout(f"{self.channel.name}: another thread was still sending after {deadline:g} s")
        try:
            self.check_open()
            peer, channel = self.server(fresh=True)  # nobody would tell that it does not serve this any more
            _, frames = self.request(channel, Flag.ONEWAY, deadline, payload)
            with as_transport_error(f"sending {self.channel.name}"):
                sent = persist(partial(peer.line.send, frames), end, partial(self.still, peer), self.closed)
            if not sent:
                self.still(peer)
                raise Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")
        finally:
            self._order.release()


class _Caller(_AskingLink):
    role, facing = "calls", "serves"

    def __init__(self, transport: ZeroMQTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._pending = Pending(channel.name)
        self._flags = Flag.IDEMPOTENT if channel.idempotent else Flag.NONE
        self._met: dict[str, _Peer] = {}
        """Those we asked, and who may still answer."""

    def met(self, peer: _Peer) -> None:
        self._met[peer.id] = peer
        peer.callers[self.client] = self

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        self.check_open()
        end = time.monotonic() + deadline
        peer, channel = self.server()
        number, frames = self.request(channel, self._flags, deadline, payload)
        key = peer.id, number
        future = self._pending.add(key, deadline)
        try:
            with as_transport_error(f"asking {self.channel.name}"):
                sent = persist(partial(peer.line.send, frames), end, partial(self.still, peer), self.closed)
        except BaseException:
            future.cancel()
            raise
        if not sent:
            self._pending.fail(key, Timeout(f"{self.channel.name}: could not be asked within {deadline:g} s"))
        self.transport.wake()
        return future

    def ask(self, payload: Payload, deadline: float) -> Reply:
        self.check_open()
        end = time.monotonic() + deadline
        try:
            while True:
                peer, channel = self.server()
                reply = self._ask(peer, channel, payload, end, deadline)
                if reply.status is not Status.REFUSED or not self.lost(peer):
                    return reply  # else it was not executed, and may be asked for where it is served now
        except (zmq.ZMQError, TransportError) as exc:
            self.check_open()  # what goes wrong because we are closed is that
            if isinstance(exc, zmq.ZMQError):
                raise TransportError(f"zeromq: asking {self.channel.name}: {exc}") from exc
            raise

    def answered(self, peer: _Peer, header: ReplyHeader, payload: Frames) -> None:
        key = peer.id, header.sequence
        try:
            reply = self._understood(Reply(Status(header.status), payload))
        except ContractMismatch as exc:
            self._pending.fail(key, exc)
        except ValueError as exc:
            self.malformed(exc)
        else:
            if reply.status is Status.REFUSED and self.lost(peer):
                self._pending.fail(key, Unreachable(f"{self.channel.name}: its server left"))
            else:
                self._pending.settle(key, reply)

    def tick(self) -> float | None:
        wait = self._pending.expire(self.transport.do)
        if len(self._pending):
            left = Unreachable(f"{self.channel.name}: its server left")
            for peer in [peer for peer in list(self._met.values()) if not peer.alive()]:
                self.transport.drop(peer)
                self._pending.fail_all(left, only=partial(_is_to, peer.id), do=self.transport.do)
        for peer in [peer for peer in list(self._met.values()) if peer.closed]:
            del self._met[peer.id]
        return wait

    def release(self) -> None:
        for peer in list(self._met.values()):
            peer.callers.pop(self.client, None)
        self._pending.close(Closed(f"{self.channel.name}: the link is closed"))

    def _ask(self, peer: _Peer, channel: bytes, payload: Payload, end: float, deadline: float) -> Reply:
        socket = peer.take()
        try:
            remaining = max(0.0, end - time.monotonic())
            number, frames = self.request(channel, self._flags, remaining, payload)
            self._send(peer, socket, frames, end, deadline)
            while True:
                header, answer = self._receive(peer, socket, end, deadline)
                if header.sequence == number and header.client == self.client:
                    return self._understood(Reply(Status(header.status), answer))
        finally:
            peer.give(socket)

    def _send(self, peer: _Peer, socket: zmq.Socket[bytes], frames: Frames, end: float, deadline: float) -> None:
        while True:
            try:
                send_frames(socket, frames)
                return
            except zmq.Again:
                self.still(peer)
                if time.monotonic() >= end:
                    raise Timeout(f"{self.channel.name}: could not be asked within {deadline:g} s") from None

    def _receive(
        self, peer: _Peer, socket: zmq.Socket[bytes], end: float, deadline: float
    ) -> tuple[ReplyHeader, Frames]:
        while True:
            left = end - time.monotonic()
            if left <= 0:
                raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s")
            try:
                if left * 1000 < _SLICE_MS and not socket.poll(max(1, int(left * 1000))):
                    continue
                frames = receive_frames(socket)
                return read_reply(frames[0]), frames[1:]
            except zmq.Again:
                self.still(peer)
            except DecodeError as exc:
                self.malformed(exc)

    def _understood(self, reply: Reply) -> Reply:
        if reply.status is Status.MISMATCH:
            text = bytes(reply.payload[0]).decode(errors="replace") if reply.payload else ""
            raise ContractMismatch(mismatch(self.channel, TypeRef("", 0, text)))
        return reply


def _is_to(peer_id: str, key: Hashable) -> bool:
    """Whether that is the key of a call to that peer."""
    return isinstance(key, tuple) and key[0] == peer_id


# -- commands and queries, the serving side -----------------------------------


class _Router:
    """The socket behind which everything is served that this transport serves."""

    def __init__(self, transport: ZeroMQTransport, bind: str) -> None:
        self._transport = transport
        self._routes: dict[bytes, _ServingLink] = {}
        self.socket = transport.socket(zmq.ROUTER, self._on_request, ROUTER_MANDATORY=1, ROUTER_HANDOVER=1)
        path = transport.member.address("router")
        self.address = f"ipc://{path}"
        try:
            for address in filter(None, (self.address, bind)):
                with as_transport_error(f"binding {address}"), self.socket.lock:
                    self.socket.raw.bind(address)
        except TransportError:
            transport.forget(self.socket)
            raise

    def add(self, link: _ServingLink) -> None:
        self._routes[link.channel.name.encode()] = link

    def remove(self, link: _ServingLink) -> None:
        name = link.channel.name.encode()
        if self._routes.get(name) is link:
            del self._routes[name]

    def reply(self, identity: bytes, request: Request, status: Status, payload: Payload = ()) -> None:
        header = pack_reply(status, request.client, request.sequence, self._transport.incarnation)
        try:
            sent = self.socket.send([identity, header, *(payload or ())])
        except zmq.ZMQError:
            return  # who asked has gone
        if not sent:
            log.warning("a reply was dropped: who asked does not take it")

    def _on_request(self, socket: _Socket) -> list[Job]:
        frames = socket.receive()
        if frames is None:
            return []
        job = self._accept(frames)
        self._transport.attend(socket)  # whether there is more is found out after this one was answered
        return [job] if job else []

    def _accept(self, frames: Frames) -> Job | None:
        identity, channel, head, *payload = [*frames, b"", b""] if len(frames) < 3 else frames
        link = self._routes.get(channel)
        try:
            request = read_request(head)
        except DecodeError as exc:
            self._malformed(link, exc)
            return None
        if link is None:
            if not request.flags & Flag.ONEWAY:
                self.reply(identity, request, Status.REFUSED)
            return None
        if request.fingerprint != link.channel.type.fingerprint:
            link.refuse_stranger(request)
            self.reply(identity, request, Status.MISMATCH, [link.channel.type.text.encode()])
            return None
        if not link.ledger.admit(request.client, request.sequence):
            return None
        remaining = float("inf") if request.remaining_ms == NO_DEADLINE else request.remaining_ms / 1000
        return link.accept(payload, time.monotonic() + remaining, partial(self._answer, identity, request))

    def _answer(self, identity: bytes, request: Request, reply: Reply) -> None:
        self.reply(identity, request, reply.status, reply.payload)

    def _malformed(self, link: _ServingLink | None, why: DecodeError) -> None:
        if link:
            link.malformed(why)
        else:
            log.warning("dropped a malformed request: %s", why)


class _ServingLink(_Link):
    ordered: bool
    _router: _Router | None = None
    _claim: Claim | None = None

    def __init__(self, transport: ZeroMQTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.ledger = Ledger(self.stats, ordered=self.ordered)

    def open(self) -> None:
        for member, entry in self.transport.directory.find(self.role, self.channel.name):
            other = entry.channel != self.channel.name  # one that has `*` in its name, or ours has
            if other and self.transport.directory.alive(member.id):
                raise AlreadyServed(f"{self.channel.name}: already served by {member.owner} (pid {member.pid})")
        self._claim = claim(self.transport.folder / "served", self.channel.name, self.transport.owner)
        self._router = self.transport.router()
        self._router.add(self)
        self.announce(self._router.address)

    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> Job | None:
        """Take a request; what is left to do about it."""
        raise NotImplementedError

    def refuse_stranger(self, request: Request) -> None:
        texts = [
            e.text
            for _, e in self.transport.directory.find(self.facing, self.channel.name)
            if e.fingerprint == request.fingerprint
        ]
        self.report_mismatch(request.fingerprint, TypeRef("", request.fingerprint, next(iter(texts), "")))

    def release(self) -> None:
        with contextlib.ExitStack() as everything:
            if self._claim:
                everything.callback(self._claim.close)
            everything.callback(self.finish)
            if self._router:
                everything.callback(self._router.remove, self)

    def finish(self) -> None:
        """Let nothing begin any more, and wait for what runs."""
        raise NotImplementedError


class _CommandInlet(_ServingLink):
    role, facing, ordered = "receives", "commands", True

    def __init__(self, transport: ZeroMQTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._sink = sink
        self._lane = Lane(channel.name, self._execute, COMMANDS_WAITING, lossy=False, stats=self.stats)

    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> Job | None:
        if self._lane.put((expires, payload)):
            return self._lane.drain
        self.stats.dropped += 1
        if self.stats.dropped == 1:
            log.warning("%s: %d commands wait; dropping more", self.channel.name, COMMANDS_WAITING)
        return None

    def finish(self) -> None:
        self._lane.close()

    def _execute(self, waiting: tuple[float, Payload]) -> None:
        expires, payload = waiting
        if time.monotonic() >= expires:
            self.stats.expired += 1
        else:
            self._sink(payload)


class _Server(_ServingLink):
    role, facing, ordered = "serves", "calls", False

    def __init__(self, transport: ZeroMQTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._service = service
        self._gate = Gate(channel.name)

    def accept(self, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> Job | None:
        return partial(self._serve, payload, expires, answer)

    def finish(self) -> None:
        self._gate.close()

    def _serve(self, payload: Payload, expires: float, answer: Callable[[Reply], None]) -> None:
        if not self._gate.enter():
            answer(Reply(Status.REFUSED))
            return
        try:
            if time.monotonic() >= expires:
                self.stats.expired += 1
                answer(Reply(Status.EXPIRED))
                return
            self.stats.received += 1
            serve(self._service, payload, expires, answer)
        finally:
            self._gate.leave()
