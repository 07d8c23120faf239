"""A transport over Unix sockets that keep packets apart (SOCK_SEQPACKET), between the processes of one Linux host.

Each process listens at one socket, and connects to those of its peers. A message may take several packets.
"""

from __future__ import annotations

import contextlib
import itertools
import select
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Iterable
from functools import partial

from robocomp_py.errors import DecodeError, Timeout, Unreachable
from robocomp_py.transports.base import Capability, Reply, TransportConfig, options_of
from robocomp_py.transports.client import CallingLink, CommandingLink, FindingLink
from robocomp_py.transports.leader_followers import Job
from robocomp_py.transports.link import Ends
from robocomp_py.transports.members import Entry, Member
from robocomp_py.transports.polling import PollingTransport
from robocomp_py.transports.server import CommandInlet, Server, ServingLink, dispatch
from robocomp_py.transports.topics import PublishingLink, SubscribingLink
from robocomp_py.wire import header
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.codec import MAX_BYTES, Payload

PACKET = 1 << 16
FRAME = struct.Struct("<QII")
"""A message begins with the number of the link that it is for, and the lengths of its header and payload."""

STALLED, IGNORED = 2.0, 3.0
"""Seconds after which a process that takes nothing is given up, and for which nothing is sent to it then."""


class Connection:
    """To another process. `id` is that of its member in the directory; "" if it was the one that connected."""

    def __init__(self, transport: PacketTransport, connected: socket.socket, id: str, number: int) -> None:
        connected.setblocking(False)
        self.id, self.key, self.closed = id, (id, number), False
        self._transport, self._socket = transport, connected
        self._sending, self._buffer, self._room = threading.Lock(), bytearray(), select.poll()
        self._room.register(connected, select.POLLOUT)
        transport.watch(connected, self._receive, partial(transport.lost, self))

    def alive(self) -> bool:
        return not self.closed and self._transport.directory.alive(self.id)

    def close(self) -> None:
        self.closed = True
        with contextlib.suppress(OSError):  # the other side was quicker
            self._socket.shutdown(socket.SHUT_RDWR)

    def send(self, link: int, head: bytes, payload: Payload, end: float) -> None:
        """Raises TimeoutError if the other process takes nothing until `end`, and OSError if it has gone."""
        data = memoryview(payload or b"")
        rest = message = memoryview(b"".join([FRAME.pack(link, len(head), data.nbytes), head, data]))
        if not self._sending.acquire(timeout=max(0.0, end - time.monotonic())):
            raise TimeoutError
        try:
            while rest:
                try:
                    rest = rest[self._socket.send(rest[:PACKET]) :]
                except BlockingIOError:
                    begun = len(rest) < len(message)
                    seconds = STALLED if begun else min(STALLED, max(0.0, end - time.monotonic()))
                    if not self._room.poll(seconds * 1000):
                        if begun:
                            self.close()  # nothing that follows half a message would be understood
                        self._transport.ignored[self.id] = time.monotonic() + IGNORED
                        raise TimeoutError from None
        finally:
            self._sending.release()

    def _receive(self) -> Iterable[Job]:
        """Take up to four messages, so that other connections have their turn."""
        jobs: list[Job | None] = []
        try:
            for _ in range(4):
                if message := self._next():
                    to, length, _ = FRAME.unpack_from(message)
                    begin = FRAME.size + length
                    jobs.append(self._transport.take(self, to, bytes(message[FRAME.size : begin]), message[begin:]))
        except OSError:
            self.close()  # so that the next call raises, too
            if not jobs:
                raise
        return filter(None, jobs)

    def _next(self) -> memoryview | None:
        """The next message with its frame; None if it has not arrived completely."""
        with contextlib.suppress(BlockingIOError):
            while packet := self._socket.recv(PACKET):
                self._buffer += packet
                if len(self._buffer) < FRAME.size:
                    raise ConnectionAbortedError("this is no message")
                _, *lengths = FRAME.unpack_from(self._buffer)
                if sum(lengths) > MAX_BYTES + PACKET:
                    raise ConnectionAbortedError(f"a message of {sum(lengths)} octets")
                if len(self._buffer) >= FRAME.size + sum(lengths):
                    message, self._buffer = self._buffer, bytearray()
                    return memoryview(message)
            raise ConnectionResetError("the other side left")
        return None


class Finding(FindingLink["PacketTransport", Connection, int]):
    def reach(self, member: Member, entry: Entry) -> Connection | None:
        try:
            return self.transport.connection(member, entry)
        except OSError:  # it has just left, or takes nothing
            return None

    def where(self, entry: Entry) -> int:
        return int(entry.address.split()[0])

    def request(
        self, peer: Connection, where: int, payload: Payload, flags: int, number: int, end: float, deadline: float
    ) -> None:
        head = header.pack_request(flags, self.channel.type.fingerprint, self.client, number, deadline)
        try:
            peer.send(where, head, payload, end)
        except OSError as exc:
            self.check_open()  # what fails because the link was closed is reported as Closed
            error = Timeout if isinstance(exc, TimeoutError) else Unreachable
            raise error(f"{self.channel.name}: its server left, or takes nothing") from exc


class CommandOutlet(CommandingLink["PacketTransport", Connection, int], Finding):
    def command(self, peer: Connection, where: int, payload: Payload, end: float, deadline: float) -> None:
        self.request(peer, where, payload, header.Flag.ONEWAY, next(self._sequence), end, deadline)


class Caller(CallingLink["PacketTransport", Connection, int], Finding):
    def open(self) -> None:
        self.transport.receivers[self.client] = self
        super().open()

    def post(self, peer: Connection, where: int, payload: Payload, number: int, end: float, deadline: float) -> bool:
        self.request(peer, where, payload, self._flags, number, end, deadline)
        return True

    def release(self) -> None:
        self.transport.receivers.pop(self.client, None)
        super().release()


class Publisher(PublishingLink["PacketTransport"]):
    def publish(self, header: bytes, payload: Payload, end: float) -> None:
        for member, entry in self.counterparts():
            try:
                peer = self.transport.connection(member, entry)
                peer.send(int(entry.address.split()[0]), header, payload, end)
            except OSError:  # it left, or takes nothing
                self.stats.dropped += 1


class Subscriber(SubscribingLink["PacketTransport"]):
    address = ""

    def open(self) -> None:
        self.address = self.transport.enlist(self)
        self.announce(self.address)

    def release(self) -> None:
        self.transport.delist(self)
        super().release()


class PacketTransport(PollingTransport):
    name = "packets"
    ends = Ends(Publisher, CommandOutlet, Subscriber, CommandInlet, Caller, Server)
    capabilities = Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        options_of(config)  # it has none
        super().__init__(config)
        self.codec = Cdr()
        self.receivers: dict[int, Caller | Subscriber | ServingLink] = {}
        self._numbers = itertools.count(1)
        self._ended: Counter[str] = Counter()  # by member: how many connections, since each has a key of its own
        self.ignored: dict[str, float] = {}  # by member: until when nothing is sent to it
        self._path = str(self.member.address("socket"))
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        listener.bind(self._path)
        listener.listen(1000)
        listener.setblocking(False)
        self.watch(listener, partial(self._accept, listener), bool)
        self.start()

    def enlist(self, link: Subscriber | ServingLink) -> str:
        number = next(self._numbers)
        self.receivers[number] = link
        return f"{number} {self._path}"

    def delist(self, link: Subscriber | ServingLink) -> None:
        if link.address:
            self.receivers.pop(int(link.address.split()[0]), None)

    def connection(self, member: Member, entry: Entry) -> Connection:
        """The connection to the process of an entry. Raises OSError if it has left, or takes nothing."""
        if time.monotonic() < self.ignored.get(member.id, 0.0):
            raise TimeoutError("it took nothing a while ago")
        key = member.id, self._ended[member.id]
        return self.asked(key, partial(self._connect, entry.address.partition(" ")[2], *key))

    def lost(self, peer: Connection) -> None:
        self._ended[peer.id] += 1
        self.drop(peer)
        self.look_soon()  # callers that wait for its replies

    def take(self, source: Connection, to: int, head: bytes, payload: Payload) -> Job | None:
        """Take a message for a link; returns the job that remains."""
        link = self.receivers.get(to)
        try:
            if isinstance(link, Caller):
                return partial(link.answered, source.key, header.read_reply(head), payload)
            if isinstance(link, Subscriber):
                return link.take(link.channel.name, header.read_publication(head), payload)
            request = header.read_request(head)
            return dispatch(link, request, payload, time.monotonic(), partial(self._answer, source, request))
        except DecodeError as exc:
            if link:
                link.malformed(exc)
            return None

    def _answer(self, client: Connection, request: header.Request, reply: Reply) -> None:
        head = header.pack_reply(reply.status, request.client, request.sequence, self.incarnation)
        with contextlib.suppress(OSError):  # the client has gone, or takes nothing
            client.send(request.client, head, reply.payload, time.monotonic() + STALLED)

    def _accept(self, listener: socket.socket) -> Iterable[Job]:
        with contextlib.suppress(OSError):  # it has left again
            Connection(self, listener.accept()[0], "", 0)
        return ()

    def _connect(self, path: str, member: str, number: int) -> Connection:
        connected = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            connected.settimeout(1.0)
            connected.connect(path)
        except OSError:
            connected.close()
            raise
        return Connection(self, connected, member, number)
