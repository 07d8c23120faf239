"""Transport `unixsock`: each process listens at a Unix socket, which others find in the directory.

    message     number of the link that it is for u64 · lengths of header and payload u32 each · header · payload

A number of 0 means a reply, whose header names its client. Replies go back on the connection of their request.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import socket
import struct
import threading
import time
from collections.abc import Iterable, Iterator
from functools import partial

from unixsock_hosts import relaying

from robocomp_py.errors import DecodeError, Timeout, Unreachable
from robocomp_py.transports.base import Capability, Reply, TransportConfig, options_of
from robocomp_py.transports.client import CallingLink, CommandingLink, FindingLink
from robocomp_py.transports.directory import Entry, Member
from robocomp_py.transports.leader_followers import Job
from robocomp_py.transports.link import Ends
from robocomp_py.transports.polling import PollingTransport
from robocomp_py.transports.server import CommandInlet, Server, ServingLink, dispatch
from robocomp_py.transports.topics import PublishingLink, SubscribingLink
from robocomp_py.wire import header
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.codec import MAX_BYTES, Codec, Payload

log = logging.getLogger("robocomp.transport.unixsock")

STALLED = 2.0
"""Seconds after which a peer that stops in the middle of a message is given up."""

IGNORED = 3.0
"""Seconds for which nothing is sent to such a peer, so that it holds up no sender again and again."""

_FRAME = struct.Struct("<QII")


class Wire:
    """A connection. One thread receives, any may send."""

    def __init__(self, connected: socket.socket) -> None:
        connected.settimeout(STALLED)
        self.socket, self._sending = connected, threading.Lock()

    def send(self, to: int, head: bytes, payload: Payload) -> None:
        """Raises OSError if the other side has gone, or takes nothing."""
        rest = memoryview(b"".join((_FRAME.pack(to, len(head), len(payload or b"")), head, payload or b"")))
        with self._sending:
            try:
                while rest:  # `sendall` would have to be done with all of a large message in time
                    rest = rest[self.socket.send(rest) :]
            except TimeoutError:
                self.shut()  # in the middle of a message: nothing that follows would be understood
                raise

    def receive(self) -> tuple[int, bytes, bytes]:
        """Raises OSError if the peer is gone or sends an invalid message."""
        to, *lengths = _FRAME.unpack(self._exactly(_FRAME.size))
        if max(lengths) > MAX_BYTES:
            raise ConnectionAbortedError(f"a message of {max(lengths)} bytes")
        head, payload = map(self._exactly, lengths)
        return to, bytes(head), bytes(payload)

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


class Peer:
    """Another process: the connection to it."""

    def __init__(self, transport: UnixSocketTransport, member: Member, address: str) -> None:
        self.id = self.key = member.id
        self.closed, self._transport = False, transport
        connected = socket.socket(socket.AF_UNIX)
        try:
            connected.connect(address)
        except OSError:
            connected.close()
            raise
        self.wire = Wire(connected)
        transport.watch(connected, partial(transport.receive, self.wire, self), self._ended)

    def send(self, to: int, head: bytes, payload: Payload) -> None:
        """Raises OSError if the process has gone, or takes nothing."""
        try:
            self.wire.send(to, head, payload)
        except TimeoutError:
            self._transport.stalls(self.id)
            raise

    def alive(self) -> bool:
        return not self.closed and self._transport.directory.alive(self.id)

    def close(self) -> None:
        self.closed = True
        self.wire.shut()

    def _ended(self) -> None:
        self._transport.drop(self)
        self._transport.look_soon()  # callers that wait for replies of that peer


class _Connecting(FindingLink["UnixSocketTransport", Peer, int]):
    def reach(self, member: Member, entry: Entry) -> Peer | None:
        try:
            return self.transport.peer(member, entry)
        except (ConnectionError, FileNotFoundError):  # it has just left
            return None
        except OSError as exc:
            raise Unreachable(f"{self.channel.name}: its server takes nothing: {exc}") from exc

    def where(self, entry: Entry) -> int:
        return _number(entry)

    @contextlib.contextmanager
    def sending(self) -> Iterator[None]:
        try:
            yield
        except TimeoutError:
            raise Timeout(f"{self.channel.name}: its server took nothing for {STALLED:g} s") from None
        except OSError as exc:
            self.check_open()  # what goes wrong because we are closed is that
            raise Unreachable(f"{self.channel.name}: its server left") from exc

    def request(self, flags: int, number: int, deadline: float) -> bytes:
        return header.pack_request(flags, self.channel.type.fingerprint, self.client, number, deadline)


class CommandOutlet(CommandingLink["UnixSocketTransport", Peer, int], _Connecting):
    def command(self, peer: Peer, where: int, payload: Payload, end: float, deadline: float) -> None:
        with self.sending():
            peer.send(where, self.request(header.Flag.ONEWAY, next(self._sequence), deadline), payload)


class Caller(CallingLink["UnixSocketTransport", Peer, int], _Connecting):
    def open(self) -> None:
        self.transport.callers[self.client] = self
        super().open()

    def post(self, peer: Peer, where: int, payload: Payload, number: int, end: float, deadline: float) -> bool:
        with self.sending():
            peer.send(where, self.request(self._flags, number, deadline), payload)
        return True

    def release(self) -> None:
        self.transport.callers.pop(self.client, None)
        super().release()


class Publisher(PublishingLink["UnixSocketTransport"]):
    def publish(self, head: bytes, payload: Payload, end: float) -> None:
        for member, entry in self.counterparts():
            try:
                self.transport.peer(member, entry).send(_number(entry), head, payload)
            except OSError:  # it left, or has stopped
                self.stats.dropped += 1


class Subscriber(SubscribingLink["UnixSocketTransport"]):
    def open(self) -> None:
        self._number, address = self.transport.number(self)
        self.announce(address)

    def release(self) -> None:
        self.transport.receiving.pop(self._number, None)
        super().release()


class UnixSocketTransport(PollingTransport):
    """Has no options. Promises nothing beyond the four verbs: whatever else a QoS demands is refused."""

    name = "unixsock"
    ends = Ends(Publisher, CommandOutlet, Subscriber, CommandInlet, Caller, Server)
    capabilities = Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        options_of(config, relay=None)
        super().__init__(config)
        self.codec: Codec = Cdr()
        self.callers: dict[int, Caller] = {}
        self.receiving: dict[int, ServingLink | Subscriber] = {}
        self._numbers = itertools.count(1)
        self.stalled: dict[str, float] = {}
        """By member: when it last took nothing."""
        self._path = str(self.member.address("socket"))
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(self._path)
        listener.listen(1000)
        self.watch(listener, partial(self._accept, listener), partial(os.unlink, self._path))
        self.start()

    @staticmethod
    def host(config: TransportConfig) -> contextlib.AbstractContextManager[None]:
        """See `SupportsHost`: the relay to other hosts, where `rcdeploy` says that one is needed."""
        relay = options_of(config, relay=None)["relay"]
        return relaying(relay) if relay else contextlib.nullcontext()

    def number(self, link: ServingLink | Subscriber) -> tuple[int, str]:
        """A number by which messages are meant for a link, and the address that others find in the directory."""
        number = next(self._numbers)
        self.receiving[number] = link
        return number, f"{number} {self._path}"

    def enlist(self, link: ServingLink) -> str:
        return self.number(link)[1]

    def delist(self, link: ServingLink) -> None:
        if link.address:
            self.receiving.pop(int(link.address.partition(" ")[0]), None)

    def stalls(self, member_id: str) -> None:
        now = time.monotonic()
        recent = {each: since for each, since in self.stalled.items() if now - since < IGNORED}
        self.stalled = recent | {member_id: now}

    def peer(self, member: Member, entry: Entry) -> Peer:
        """Raises OSError if it does not listen, or took nothing a while ago."""
        if time.monotonic() - self.stalled.get(member.id, -IGNORED) < IGNORED:
            raise TimeoutError
        return self.asked(member.id, partial(Peer, self, member, entry.address.partition(" ")[2]))

    def _accept(self, listener: socket.socket) -> Iterable[Job]:
        wire = Wire(listener.accept()[0])
        self.watch(wire.socket, partial(self.receive, wire, None), _nothing)
        return ()

    def receive(self, wire: Wire, peer: Peer | None) -> Iterable[Job]:
        """The next message of a connection. Raises OSError when that has ended."""
        to, head, payload = wire.receive()
        link = self.receiving.get(to)
        try:
            if peer:
                reply = header.read_reply(head)
                caller = self.callers.get(reply.client)
                return (partial(caller.answered, peer.key, reply, payload),) if caller else ()
            if isinstance(link, Subscriber):
                job = link.take(link.channel.name, header.read_publication(head), payload)
            else:
                request = header.read_request(head)
                job = dispatch(link, request, payload, time.monotonic(), partial(self._answer, wire, request))
            return (job,) if job else ()
        except DecodeError as exc:
            if link:
                link.malformed(exc)
            return ()

    def _answer(self, wire: Wire, request: header.Request, reply: Reply) -> None:
        head = header.pack_reply(reply.status, request.client, request.sequence, self.incarnation)
        with contextlib.suppress(OSError):  # the client has gone
            wire.send(0, head, reply.payload)


def _number(entry: Entry) -> int:
    return int(entry.address.partition(" ")[0])


def _nothing() -> None: ...
