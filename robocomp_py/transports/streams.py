"""A base for transports over connections of Python's sockets, which keep bytes in order, as TCP does.

A subclass listens, and connects to an address. What is here frames messages, tells connections of other programs from
those of ours, and gives up peers that stop in the middle of a message. See `docs/guides/transports.md`.

    connection   token of the listener, 16 octets, from the side that connects; then messages in both directions
    message      number of the link that it is for u64 · lengths of header and payload u32 each · header · payload

A number of 0 means a reply, whose header names its client. Replies go back on the connection of their request.
"""

from __future__ import annotations

import contextlib
import hmac
import itertools
import logging
import secrets
import select
import socket
import struct
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

from ..errors import DecodeError, Timeout, Unreachable
from ..wire import header
from ..wire.cdr import Cdr
from ..wire.codec import MAX_BYTES, Codec, Payload
from .base import Capability, Reply, TransportConfig
from .client import CallingLink, CommandingLink, FindingLink
from .leader_followers import Job
from .link import Ends
from .members import Entry, Member
from .polling import PollingTransport
from .server import CommandInlet, Server, ServingLink, dispatch
from .topics import PublishingLink, SubscribingLink

log = logging.getLogger("robocomp.transport")

STALLED = 2.0
"""Seconds without progress after which a peer that stops in the middle of a message is given up."""

IGNORED = 3.0
"""Seconds for which nothing is sent to such a peer, so that it does not hold up a sender with every message."""

_AT_ONCE = 4
"""Messages taken from one connection before the next one has its turn."""

_LONGEST_HEADER = 4096

_PAUSE = 0.01
"""Seconds between two attempts to accept a connection while there are no file descriptors left."""

_TCP = socket.AF_INET, socket.AF_INET6

_FRAME = struct.Struct("<QII")
_TOKEN = 16
"""Octets of a token."""


class Message(NamedTuple):
    """`to` is the number of a link, or 0 for a reply."""

    to: int
    header: bytes
    payload: Payload


class Connection:
    """Messages over a connected socket. One thread receives, any may send. All methods raise OSError at its end."""

    def __init__(self, connected: socket.socket) -> None:
        connected.setblocking(False)
        if connected.family in _TCP:
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket, self._sending, self._room = connected, threading.Lock(), select.poll()
        self._room.register(connected, select.POLLOUT)
        self._buffer, self._filled = bytearray(_FRAME.size), 0
        self._frame: tuple[int, int] | None = None
        """Of the message that is being received: its number, and the length of its header."""

    def send(self, message: Message, end: float) -> None:
        """Raises TimeoutError if the other side takes nothing until `end`, or stops in the middle of the message."""
        head, payload = message.header, message.payload or b""
        parts = _FRAME.pack(message.to, len(head), len(payload)) + head, payload
        if not self._sending.acquire(timeout=max(0.0, end - time.monotonic())):
            raise TimeoutError
        try:
            self._send(parts, end)
        finally:
            self._sending.release()

    def begin(self, token: bytes) -> None:
        """Say that this is a connection of ours. The first octets always fit."""
        self.socket.send(token)

    def receive(self) -> Message | None:
        """The next message; None if it has not arrived completely."""
        if self._frame is None:
            if not self._fill():
                return None
            to, *lengths = _FRAME.unpack(self._buffer)
            if lengths[0] > _LONGEST_HEADER or lengths[1] > MAX_BYTES:
                raise ConnectionAbortedError(f"a message of {sum(lengths)} octets")
            self._frame = to, lengths[0]
            self._expect(sum(lengths))
        if not self._fill():
            return None
        (to, length), data = self._frame, memoryview(self._buffer)
        self._frame = None
        self._expect(_FRAME.size)
        return Message(to, bytes(data[:length]), data[length:])

    def octets(self, number: int) -> bytes | None:
        """The first octets of a connection, which are no message; None if they have not arrived completely."""
        if len(self._buffer) != number:
            self._expect(number)
        if not self._fill():
            return None
        found = bytes(self._buffer)
        self._expect(_FRAME.size)
        return found

    def shut(self) -> None:
        with contextlib.suppress(OSError):  # the other side was quicker
            self.socket.shutdown(socket.SHUT_RDWR)

    def _send(self, parts: tuple[Payload, ...], end: float) -> None:
        begun = False
        for part in parts:
            rest = memoryview(part).cast("B")
            while rest:
                try:
                    rest = rest[self.socket.send(rest) :]
                    begun = True
                except BlockingIOError:
                    limit = STALLED if begun else min(STALLED, end - time.monotonic())
                    if limit <= 0 or not self._room.poll(limit * 1000):
                        if begun:
                            self.shut()  # nothing that follows half a message would be understood
                        raise TimeoutError from None

    def _expect(self, number: int) -> None:
        self._buffer, self._filled = bytearray(number), 0

    def _fill(self) -> bool:
        """Receive what is there of the expected octets; returns whether they are complete."""
        while self._filled < len(self._buffer):
            try:
                got = self.socket.recv_into(memoryview(self._buffer)[self._filled :])
            except BlockingIOError:
                return False
            if not got:
                raise ConnectionResetError("the other side left")
            self._filled += got
        return True


class Process:
    """A connection to another process, as clients see it."""

    def __init__(self, transport: StreamTransport, key: tuple[str, int], where: _Address) -> None:
        self.id, self.key, self.closed, self._transport = key[0], key, False, transport
        connected = transport.connect(where.place)
        try:
            if connected.family in _TCP and connected.getsockname() == connected.getpeername():
                raise ConnectionRefusedError("a port of TCP that is free can connect to itself")
            self.connection = Connection(connected)
            self.connection.begin(where.token)
        except OSError:
            connected.close()
            raise
        transport.watch(connected, self._receive, partial(transport.lost, self))

    def send(self, message: Message, end: float) -> None:
        """Raises OSError if the process has gone, or takes nothing."""
        try:
            self.connection.send(message, end)
        except TimeoutError:
            self._transport.stalls(self.id)
            raise

    def alive(self) -> bool:
        return not self.closed and self._transport.directory.alive(self.id)

    def close(self) -> None:
        self.closed = True
        self.connection.shut()

    def _receive(self) -> Iterable[Job]:
        return _messages(self.connection, partial(self._transport.replied, self))


class _Address(NamedTuple):
    """What the directory says of a link: its number, and where its process listens."""

    number: int
    token: bytes
    place: str

    @classmethod
    def of(cls, entry: Entry) -> _Address:
        number, token, place = entry.address.split(" ", 2)
        return cls(int(number), bytes.fromhex(token), place)


class _Connecting(FindingLink["StreamTransport", Process, int]):
    def reach(self, member: Member, entry: Entry) -> Process | None:
        try:
            return self.transport.process(member, entry)
        except (ConnectionError, FileNotFoundError):  # it has just left
            return None
        except OSError as exc:
            raise Unreachable(f"{self.channel.name}: its server takes nothing: {exc}") from exc

    def where(self, entry: Entry) -> int:
        return _Address.of(entry).number

    def request(
        self, peer: Process, where: int, payload: Payload, flags: int, number: int, end: float, deadline: float
    ) -> None:
        head = header.pack_request(flags, self.channel.type.fingerprint, self.client, number, deadline)
        try:
            peer.send(Message(where, head, payload), end)
        except TimeoutError:
            self.check_open()  # what fails because the link was closed is reported as Closed
            raise Timeout(f"{self.channel.name}: its server takes nothing") from None
        except OSError as exc:
            self.check_open()
            raise Unreachable(f"{self.channel.name}: its server left") from exc


class CommandOutlet(CommandingLink["StreamTransport", Process, int], _Connecting):
    def command(self, peer: Process, where: int, payload: Payload, end: float, deadline: float) -> None:
        self.request(peer, where, payload, header.Flag.ONEWAY, next(self._sequence), end, deadline)


class Caller(CallingLink["StreamTransport", Process, int], _Connecting):
    def open(self) -> None:
        self.transport.callers[self.client] = self
        super().open()

    def post(self, peer: Process, where: int, payload: Payload, number: int, end: float, deadline: float) -> bool:
        self.request(peer, where, payload, self._flags, number, end, deadline)
        return True

    def release(self) -> None:
        self.transport.callers.pop(self.client, None)
        super().release()


class Publisher(PublishingLink["StreamTransport"]):
    def publish(self, header: bytes, payload: Payload, end: float) -> None:
        for member, entry in self.counterparts():
            try:
                self.transport.process(member, entry).send(Message(_Address.of(entry).number, header, payload), end)
            except OSError:  # it left, or has stopped
                self.stats.dropped += 1


class Subscriber(SubscribingLink["StreamTransport"]):
    address = ""

    def open(self) -> None:
        self.address = self.transport.enlist(self)
        self.announce(self.address)

    def release(self) -> None:
        self.transport.delist(self)
        super().release()


class StreamTransport(PollingTransport):
    """A subclass has a `name` and `connect`. Its `__init__` calls `super().__init__`, `listen`, and `start` last."""

    ends = Ends(Publisher, CommandOutlet, Subscriber, CommandInlet, Caller, Server)
    capabilities = Capability.CROSS_PROCESS
    codec: Codec

    def __init__(self, config: TransportConfig) -> None:
        super().__init__(config)
        self.codec = Cdr()
        self.callers: dict[int, Caller] = {}
        self.receiving: dict[int, ServingLink | Subscriber] = {}
        self._numbers = itertools.count(1)
        self._keys: dict[str, tuple[str, int]] = {}
        """By member, the key of the connection to it. A new connection has a new key, since calls wait by key."""
        self._stalled: dict[str, float] = {}
        """By member, when it last took nothing."""
        self._token, self._place = secrets.token_bytes(_TOKEN), ""

    @abstractmethod
    def connect(self, place: str) -> socket.socket:
        """Connect to where another process listens, within a second. Raises OSError."""

    def listen(self, listener: socket.socket, place: str) -> None:
        """Accept connections, from now on until the transport closes. Call it once.

        `place` is what `connect` of other processes gets: one line.
        """
        listener.setblocking(False)
        self._place = place
        self.watch(listener, partial(self._accept, listener), bool)

    def enlist(self, link: ServingLink | Subscriber) -> str:
        number = next(self._numbers)
        self.receiving[number] = link
        return f"{number} {self._token.hex()} {self._place}"

    def delist(self, link: ServingLink | Subscriber) -> None:
        if link.address:
            self.receiving.pop(int(link.address.partition(" ")[0]), None)

    def process(self, member: Member, entry: Entry) -> Process:
        """The process of a member. Raises OSError if it does not listen, or took nothing a while ago."""
        if time.monotonic() - self._stalled.get(member.id, -IGNORED) < IGNORED:
            raise TimeoutError("it took nothing a while ago")
        key = self._keys.setdefault(member.id, (member.id, next(self._numbers)))
        try:
            return self.asked(key, partial(Process, self, key, _Address.of(entry)))
        except OSError:
            self._forget(key)
            raise

    def stalls(self, member: str) -> None:
        """Note that a member takes nothing."""
        now = time.monotonic()
        recent = {each: since for each, since in self._stalled.items() if now - since < IGNORED}
        self._stalled = recent | {member: now}

    def lost(self, peer: Process) -> None:
        """The connection to a process has ended."""
        self._forget(peer.key)
        self.drop(peer)
        self.look_soon()  # callers that wait for its replies

    def replied(self, peer: Process, message: Message) -> Job | None:
        """Take a reply of a process; returns the job that remains."""
        reply = header.read_reply(message.header)
        caller = self.callers.get(reply.client)
        return partial(caller.answered, peer.key, reply, message.payload) if caller else None

    def _forget(self, key: tuple[str, int]) -> None:
        if self._keys.get(key[0]) == key:
            self._keys.pop(key[0], None)

    def _accept(self, listener: socket.socket) -> Iterable[Job]:
        try:
            connection = Connection(listener.accept()[0])
        except (BlockingIOError, ConnectionError):
            return ()  # it has left again
        except OSError as exc:
            log.warning("%s: a connection is not accepted now: %s", self.name, exc)
            time.sleep(_PAUSE)
            return ()
        self.watch(connection.socket, _Accepted(self, connection, self._token).receive, bool)
        return ()


class _Accepted:
    """A connection from another process, as servers and subscribers see it."""

    def __init__(self, transport: StreamTransport, connection: Connection, token: bytes) -> None:
        self._transport, self._connection, self._token = transport, connection, token
        self._is_ours = False

    def receive(self) -> Iterable[Job]:
        if not self._is_ours:
            token = self._connection.octets(_TOKEN)
            if token is None:
                return ()
            if not hmac.compare_digest(token, self._token):
                raise ConnectionRefusedError("it does not know the token")
            self._is_ours = True
        return _messages(self._connection, self._requested)

    def _requested(self, message: Message) -> Job | None:
        link = self._transport.receiving.get(message.to)
        try:
            if isinstance(link, Subscriber):
                publication = header.read_publication(message.header)
                return link.take(link.channel.name, publication, message.payload)
            request = header.read_request(message.header)
            return dispatch(link, request, message.payload, time.monotonic(), partial(self._answer, request))
        except DecodeError as exc:
            if link:
                link.malformed(exc)
            return None

    def _answer(self, request: header.Request, reply: Reply) -> None:
        head = header.pack_reply(reply.status, request.client, request.sequence, self._transport.incarnation)
        with contextlib.suppress(OSError):  # the client has gone, or takes nothing
            self._connection.send(Message(0, head, reply.payload), time.monotonic() + STALLED)


def _messages(connection: Connection, take: Callable[[Message], Job | None]) -> Iterable[Job]:
    """Receive some messages; returns the jobs that remain. Raises OSError if the connection has ended."""
    jobs: list[Job] = []
    try:
        for _ in range(_AT_ONCE):
            message = connection.receive()
            if message is None:
                break
            if job := take(message):
                jobs.append(job)
    except (OSError, DecodeError) as exc:
        connection.shut()  # so that the next call raises, too
        if not jobs:
            raise ConnectionAbortedError(str(exc)) from exc
    return jobs
