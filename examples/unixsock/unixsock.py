"""Transport `unixsock`: a Unix socket for every inlet and server, which others find in the directory.

    outlet → inlet     header · payload
    caller → server    header · payload, and the reply back on the same connection

Every message is preceded by the two lengths.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from functools import partial
from typing import TypeVar

from robocomp_py.contract.interface import Pattern
from robocomp_py.errors import Closed, ContractMismatch, DecodeError, Timeout, TransportError, Unreachable
from robocomp_py.transports.base import (
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
)
from robocomp_py.transports.crew import Crew, Job, Lane, Servant
from robocomp_py.transports.directory import Directory, Entry, Member, runtime_dir
from robocomp_py.transports.exclusive import Claim, claim
from robocomp_py.transports.pending import Pending
from robocomp_py.wire import header
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.codec import MAX_BYTES, Codec, Payload

log = logging.getLogger("robocomp.transport.unixsock")

TICK = 0.05
"""Seconds between two looks at who is there and what is overdue."""

STALLED = 2.0
"""Seconds after which somebody who stops in the middle of a message is given up."""

COMMANDS_WAITING = 1000

Ended = Callable[[], "list[Job] | None"]
L = TypeVar("L", bound="_Link")
_LENGTHS = struct.Struct("<II")


class UnixSocketTransport:
    """Has no options. Promises nothing beyond the four verbs: whatever else a QoS demands is refused."""

    capabilities = Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        options_of(config)
        self.codec: Codec = Cdr()
        self.owner, self.folder, self.id = config.owner, runtime_dir() / "unixsock", header.random_id()
        self.closed = False
        self.directory = Directory(self.folder)
        self.member = self.directory.join(config.owner)
        self._links: list[_Link] = []
        self._numbers = itertools.count(1)
        self._watched: dict[int, tuple[socket.socket, Callable[[], list[Job]], Ended]] = {}
        self._known = -1
        self._wakes, self._wake = socket.socketpair()
        self._crew = Crew("unixsock", self._receive, self.wake)
        self._crew.start()

    def outlet(self, channel: Channel) -> _Outlet:
        return self._open(_Outlet(self, channel))

    def inlet(self, channel: Channel, sink: Sink) -> _Inlet:
        return self._open(_Inlet(self, channel, sink))

    def caller(self, channel: Channel) -> _Caller:
        return self._open(_Caller(self, channel))

    def server(self, channel: Channel, service: Service) -> _Server:
        return self._open(_Server(self, channel, service))

    def close(self) -> None:
        if not self.closed:
            self.closed = True
            for link in list(self._links):
                link.close()
            self._crew.close()
            for each, *_ in list(self._watched.values()):
                each.close()
            self._wakes.close()
            self._wake.close()
            self.member.close()

    def left(self, link: _Link) -> None:
        with contextlib.suppress(ValueError):  # it was never opened
            self._links.remove(link)

    def new_path(self) -> str:
        return str(self.member.address(str(next(self._numbers))))

    def watch(self, what: socket.socket, ready: Callable[[], list[Job]], ended: Ended) -> None:
        """Have the receiving thread call `ready` when there is input, and close it when that raises OSError.

        So only that thread closes sockets: whoever wants one closed shuts it down.
        """
        self._watched[what.fileno()] = what, ready, ended
        self.wake()

    def wake(self) -> None:
        with contextlib.suppress(OSError):  # closed meanwhile
            self._wake.send(b"x")

    def _open(self, link: L) -> L:
        try:
            if self.closed:
                raise Closed("the transport is closed")
            link.open()
        except OSError as exc:
            link.close()
            raise TransportError(f"{link.channel.name}: cannot be opened: {exc.strerror}") from exc
        except BaseException:
            link.close()
            raise
        self._links.append(link)
        link.peers()
        return link

    def _receive(self) -> Iterable[Job]:
        jobs = self._tick()
        watched = dict(self._watched)
        poll = select.poll()
        for fd in (self._wakes.fileno(), *watched):
            poll.register(fd, select.POLLIN)
        for fd, _ in poll.poll(0 if jobs else TICK * 1000):
            if fd == self._wakes.fileno():
                self._wakes.recv(4096)
                continue
            what, ready, ended = watched[fd]
            try:
                jobs += ready()
            except OSError:
                del self._watched[fd]
                what.close()
                jobs += ended() or ()
        return jobs

    def _tick(self) -> list[Job]:
        jobs: list[Job] = []
        version = self.directory.version()
        for link in list(self._links):
            if version != self._known:
                link.peers()  # says so if somebody means something else
            if isinstance(link, _Caller):
                link.pending.expire(jobs.append)
        self._known = version
        return jobs


class _Wire:
    """A connection: one thread receives, any may send."""

    def __init__(self, connected: socket.socket) -> None:
        connected.settimeout(STALLED)
        self.socket = connected
        self._sending = threading.Lock()

    def send(self, head: bytes, payload: Payload) -> None:
        """Raises OSError if the other side has gone, or takes nothing."""
        message = b"".join((_LENGTHS.pack(len(head), len(payload or b"")), head, payload or b""))
        with self._sending:
            try:
                self.socket.sendall(message)
            except TimeoutError:
                self.shut()  # in the middle of a message: nothing that follows would be understood
                raise

    def receive(self) -> tuple[bytes, bytes]:
        """Raises OSError when the other side has gone, or what comes is no message."""
        lengths = _LENGTHS.unpack(self._exactly(_LENGTHS.size))
        if max(lengths) > MAX_BYTES:
            raise ConnectionAbortedError(f"a message of {max(lengths)} bytes")
        head, payload = map(self._exactly, lengths)
        return bytes(head), bytes(payload)

    def shut(self) -> None:
        with contextlib.suppress(OSError):  # the other side was quicker
            self.socket.shutdown(socket.SHUT_RDWR)

    def _exactly(self, number: int) -> bytearray:
        data = bytearray(number)
        rest = memoryview(data)
        while rest:
            got = self.socket.recv_into(rest)
            if not got:
                raise ConnectionResetError("the other side left")
            rest = rest[got:]
        return data


class _Link:
    """One end of a channel. `role` and `facing` are how the two ends are called in the directory."""

    role: str
    facing: str

    def __init__(self, transport: UnixSocketTransport, channel: Channel) -> None:
        self.transport, self.channel = transport, channel
        self.id, self.stats = header.random_id(), Statistics()
        self.closed = threading.Event()
        self._closing = threading.Lock()
        self._entry: Entry | None = None
        self._reported: set[Entry] = set()

    def open(self) -> None:
        self.announce("")

    def announce(self, address: str) -> None:
        kind = self.channel.type
        self._entry = Entry(self.role, self.channel.name, kind.fingerprint, kind.text, address)
        self.transport.member.add(self._entry)

    def peers(self, *, strict: bool = False) -> list[Entry]:
        """The other ends that mean the same; others are reported. With `strict`, raises if there are only others."""
        found = self.transport.directory.find(self.facing, self.channel.name)
        named = [entry for member, entry in found if self._counts(member, entry)]
        same = [entry for entry in named if entry.fingerprint == self.channel.type.fingerprint]
        for entry in named:
            what = mismatch(self.channel, TypeRef("", entry.fingerprint, entry.text))
            if entry not in same and entry not in self._reported:
                self._reported.add(entry)
                log.error("%s", what)
                self.stats.mismatched += 1
        if strict and named and not same:
            raise ContractMismatch(what)
        return same

    def wait_peer(self, timeout: float) -> bool:
        end = time.monotonic() + timeout
        while True:
            self.check_open()
            if self.peers(strict=True):
                return True
            if time.monotonic() >= end:
                return False
            self.closed.wait(0.005)

    def check_open(self) -> None:
        if self.closed.is_set():
            raise Closed(f"{self.channel.name}: the link is closed")

    def close(self) -> None:
        with self._closing:
            if self.closed.is_set():
                return
            self.closed.set()
        if self._entry:
            self.transport.member.remove(self._entry)
        self.transport.left(self)
        self.release()

    def release(self) -> None:
        """Let go of everything; called once."""
        raise NotImplementedError

    def _counts(self, member: Member, entry: Entry) -> bool:
        """Whether it lives, and is not ourselves, found by "any instance"."""
        itself = member.id == self.transport.member.id and entry.channel != self.channel.name
        return not itself and self.transport.directory.alive(member.id)


class _Connecting(_Link):
    """A link that connects to those it faces."""

    def __init__(self, transport: UnixSocketTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._wires: dict[str, _Wire] = {}
        self._connecting = threading.Lock()

    def wire(self, address: str) -> _Wire:
        """Raises OSError if nobody listens there."""
        with self._connecting:
            self.check_open()
            if address not in self._wires:
                plain = socket.socket(socket.AF_UNIX)
                try:
                    plain.connect(address)
                except OSError:
                    plain.close()
                    raise
                wire = self._wires[address] = _Wire(plain)
                self.transport.watch(plain, partial(self.ready, wire), partial(self.ended, address, wire))
            return self._wires[address]

    def server(self) -> str:
        """Where the channel is served. Raises Unreachable."""
        for entry in self.peers(strict=True):
            return entry.address
        raise Unreachable(f"{self.channel.name}: nobody serves it")

    def left(self) -> TransportError:
        """What it means that a connection failed."""
        name = self.channel.name
        return (
            Closed(f"{name}: the link is closed") if self.closed.is_set() else Unreachable(f"{name}: its server left")
        )

    def ready(self, wire: _Wire) -> list[Job]:
        wire.receive()  # nobody sends anything but its end
        return []

    def ended(self, address: str, wire: _Wire) -> list[Job]:
        """On the receiving thread: a connection is over. What is to be done about it."""
        with self._connecting:
            del self._wires[address]
        return []

    def release(self) -> None:
        with self._connecting:
            for wire in self._wires.values():
                wire.shut()


class _Outlet(_Connecting):
    def __init__(self, transport: UnixSocketTransport, channel: Channel) -> None:
        self._topic = channel.pattern is Pattern.PUBLISH
        self.role, self.facing = ("publishes", "subscribes") if self._topic else ("commands", "receives")
        super().__init__(transport, channel)
        self._order = threading.Lock()
        self._numbers = itertools.count(1)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        self.check_open()
        if not self._order.acquire(timeout=max(0.0, deadline)):
            raise Timeout(f"{self.channel.name}: another thread was still sending after {deadline:g} s")
        with contextlib.ExitStack() as sending:
            sending.callback(self._order.release)
            number, fingerprint = next(self._numbers), self.channel.type.fingerprint
            if self._topic:
                self._publish(header.pack_publication(fingerprint, self.id, number, time.time_ns()), payload)
            else:
                self._command(header.pack_request(header.Flag.ONEWAY, fingerprint, self.id, number, deadline), payload)

    def _publish(self, head: bytes, payload: Payload) -> None:
        for entry in self.peers():
            try:
                self.wire(entry.address).send(head, payload)
            except OSError:  # it left, or has stopped
                self.stats.dropped += 1

    def _command(self, head: bytes, payload: Payload) -> None:
        try:
            self.wire(self.server()).send(head, payload)
        except TimeoutError:
            raise Timeout(f"{self.channel.name}: its server took nothing for {STALLED:g} s") from None
        except OSError as exc:
            raise self.left() from exc


class _Caller(_Connecting):
    role, facing = "calls", "serves"

    def __init__(self, transport: UnixSocketTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._numbers = itertools.count(1)
        self._flags = header.Flag.IDEMPOTENT if channel.idempotent else header.Flag.NONE
        self.pending = Pending(channel.name)

    def ask(self, payload: Payload, deadline: float) -> Reply:
        future = self.call(payload, deadline)
        try:
            return future.result(deadline)
        except FutureTimeout:
            future.cancel()
            raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s") from None

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        self.check_open()
        number, address = next(self._numbers), self.server()
        try:
            wire = self.wire(address)
        except OSError as exc:
            raise self.left() from exc
        future = self.pending.add((wire, number), deadline)
        head = header.pack_request(self._flags, self.channel.type.fingerprint, self.id, number, deadline)
        try:
            wire.send(head, payload)
        except OSError as exc:
            future.cancel()
            raise self.left() from exc
        return future

    def ready(self, wire: _Wire) -> list[Job]:
        head, payload = wire.receive()
        try:
            reply = header.read_reply(head)
            key = wire, reply.sequence
            if reply.status == Status.MISMATCH:
                theirs = TypeRef("", 0, payload.decode(errors="replace"))
                return [partial(self.pending.fail, key, ContractMismatch(mismatch(self.channel, theirs)))]
            return [partial(self.pending.settle, key, Reply(Status(reply.status), payload))]
        except (DecodeError, ValueError):
            self.stats.malformed += 1
            return []

    def ended(self, address: str, wire: _Wire) -> list[Job]:
        jobs = super().ended(address, wire)
        self.pending.fail_all(self.left(), only=lambda key: isinstance(key, tuple) and key[0] is wire, do=jobs.append)
        return jobs

    def release(self) -> None:
        self.pending.close(Closed(f"{self.channel.name}: the link is closed"))
        super().release()


class _Listening(_Link):
    """A link that others connect to. `alone` is whether a channel may have only one such end."""

    alone = True

    def __init__(self, transport: UnixSocketTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._claim: Claim | None = None
        self._listener = socket.socket(socket.AF_UNIX)
        self._wires: set[_Wire] = set()

    def open(self) -> None:
        transport, path = self.transport, self.transport.new_path()
        if self.alone:
            self._claim = claim(transport.folder, self.channel.name, transport.owner)
        self._listener.bind(path)
        self._listener.listen(1000)
        transport.watch(self._listener, self._accept, partial(os.unlink, path))
        self.announce(path)

    def _accept(self) -> list[Job]:
        wire = _Wire(self._listener.accept()[0])
        self._wires.add(wire)
        self.transport.watch(wire.socket, partial(self._ready, wire), partial(self._wires.discard, wire))
        return []

    def _ready(self, wire: _Wire) -> list[Job]:
        head, payload = wire.receive()
        try:
            job = self.take(wire, head, payload)
        except DecodeError as exc:
            self.stats.malformed += 1
            if self.stats.malformed == 1:
                log.warning(
                    "%s: dropped a malformed message (further ones are only counted): %s", self.channel.name, exc
                )
            return []
        return [job] if job else []

    def take(self, wire: _Wire, head: bytes, payload: bytes) -> Job | None:
        """What is to be done about a message. Raises DecodeError."""
        raise NotImplementedError

    def release(self) -> None:
        if self._entry:
            self._listener.shutdown(socket.SHUT_RDWR)
        else:  # opening failed, so nobody watches it
            self._listener.close()
        for wire in list(self._wires):
            wire.shut()
        if self._claim:
            self._claim.close()


class _Inlet(_Listening):
    def __init__(self, transport: UnixSocketTransport, channel: Channel, sink: Sink) -> None:
        topic = channel.pattern is Pattern.PUBLISH
        self.role, self.facing = ("subscribes", "publishes") if topic else ("receives", "commands")
        self.alone, self._read = not topic, header.read_publication if topic else header.read_request
        super().__init__(transport, channel)
        depth = channel.qos.depth if topic else COMMANDS_WAITING
        self._lane = Lane(channel.name, sink, depth, lossy=topic, stats=self.stats)

    def take(self, wire: _Wire, head: bytes, payload: bytes) -> Job | None:
        if self._read(head).fingerprint != self.channel.type.fingerprint:
            return None  # from one that did not look; said already, since the directory tells
        if not self._lane.put(payload):
            self.stats.dropped += 1
        return self._lane.drain

    def release(self) -> None:
        super().release()
        self._lane.close()


class _Server(_Listening):
    role, facing = "serves", "calls"

    def __init__(self, transport: UnixSocketTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._servant = Servant(channel.name, service, self.stats)

    def take(self, wire: _Wire, head: bytes, payload: bytes) -> Job | None:
        request = header.read_request(head)
        expires = time.monotonic() + request.remaining_ms / 1000
        return partial(self._serve, partial(self._answer, wire, request), request, payload, expires)

    def _serve(
        self, answer: Callable[[Reply], object], request: header.Request, payload: bytes, expires: float
    ) -> None:
        mine = self.channel.type
        if request.fingerprint != mine.fingerprint:
            answer(Reply(Status.MISMATCH, mine.text.encode()))
        else:
            self._servant.serve(payload, expires, answer)

    def _answer(self, wire: _Wire, request: header.Request, reply: Reply) -> None:
        head = header.pack_reply(reply.status, request.client, request.sequence, self.transport.id)
        with contextlib.suppress(OSError):  # who asked has gone
            wire.send(head, reply.payload)

    def release(self) -> None:
        self._servant.close()
        super().release()
