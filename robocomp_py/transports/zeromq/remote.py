"""Remote members: members of the directory that are reached by TCP and have no file in the run-time folder.

A transport with the option `connect` sends its own record to each of these addresses at intervals; a transport with
`bind` replies with its record. Each treats the other as a member of its directory while messages arrive. So links find
and lose each other as they do on one host.

    request, reply        the topic `robocomp/directory` with the header of a request or reply, followed by JSON:
                          {"id": …, "owner": …, "pid": …, "entries": […]}, as in a file of the directory

The entry of a topic gives its own port on the same host: `tcp://*:40123#a1b2c3`.
"""

from __future__ import annotations

import contextlib
import json
import logging
import re
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import zmq

from ...errors import DecodeError
from ...wire.header import Flag, pack_request, random_id
from ..directory import Directory
from ..keyfiles import Rights
from ..leader_followers import Job
from ..members import Entry, Found, Member, member_of, told_of
from .bounds import Kind
from .curve import Secure
from .frames import Frames, joined, read_reply_frames, topic
from .sockets import Socket, as_transport_error, new_socket, receive_frames, send_frames
from .zmtp import SLICE_MS, Wait

if TYPE_CHECKING:
    from .reactor import Reactor

log = logging.getLogger("robocomp.transport.zeromq")

DIRECTORY = topic("robocomp/directory")

SILENT = 2.0
"""Seconds without a message after which a remote member counts as gone."""

_EAGER, _USUAL = 0.1, 0.5
"""Seconds between two requests: until the first reply, and afterwards."""

_UNANSWERED = 3.0
"""Seconds without a reply after which that is logged."""

_NO_REPLY, _NO_MORE = "no reply", "no reply any more"
_NEEDS_KEYS = "this process has no keys, and needs some (start it with --keys FOLDER)"

_HALF_A_GREETING = b"\xff\0\0\0\0\0\0\0\1\x7f\3"
"""Signature and version of ZMTP 3."""

_GREETING, _MECHANISM = 64, slice(12, 32)
"""Octets of a whole greeting, and where it names the mechanism."""

_PROBING = 1.0
"""Seconds for each step of reading a greeting."""

ACQUAINTED = 0.5
"""Seconds within which two transports find each other at an address: they try to connect every 0.2 s or more often."""

_SETTLING = 1.0
"""Maximum seconds for which new services of a member stay hidden until this transport is connected to its topics."""

_MOST, MOST_ENTRIES = 250, 50_000
"""Maximum number of remote members, and of all their entries. Each takes some hundred octets."""

_LONGEST = 1024 * 1024
"""Maximum octets of a record."""

_SERVING = ("serves", "receives")
_OFFERING, _WANTING = (*_SERVING, "publishes"), ("calls", "commands", "subscribes")

_BEAT = SILENT / 4
"""Seconds between two checks for silent members. A longer gap counts as this, since it is a delay of this process."""

_AT_FAR = {
    "TCP_KEEPALIVE": 1,
    "TCP_KEEPALIVE_IDLE": 2,
    "TCP_KEEPALIVE_INTVL": 1,
    "TCP_KEEPALIVE_CNT": 3,
    "TCP_MAXRT": 5000,
}
"""The kernel notices a connection that was cut, within five seconds. A silent member is noticed sooner.

ZeroMQ's heartbeats would do the same, but end the process ("Assertion failed: !_io_error", libzmq 4.3.5) if the other
side closes a connection whose messages this side has not received for half a second."""

_TO_FAR = {
    "IMMEDIATE": 1,  # no queueing without a connection
    "RECONNECT_IVL": 100,
    "RECONNECT_IVL_MAX": 400,
    "CONNECT_TIMEOUT": 1000,  # otherwise the longer timeout of the system applies after a cut
}

_ADDRESS = re.compile(r"tcp://(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._*-]+):(\d{1,5})(?:#[0-9a-f]{6})?")


def is_far(address: str) -> bool:
    return address.startswith("tcp://")


def at_far(address: str) -> dict[str, int]:
    """Options of a socket that is bound there, and of those beside it."""
    return _AT_FAR | ({"IPV6": 1} if "[" in address else {})


def to_far(address: str) -> dict[str, int]:
    """Options of a socket that connects there."""
    return at_far(address) | _TO_FAR


def host_of(address: str) -> str:
    """The host of an address `tcp://HOST:PORT`; empty if it is another address."""
    found = _ADDRESS.fullmatch(address)
    return found[1] if found else ""


class Neighbours(Directory):
    """The directory of one folder, together with the remote members."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._far: dict[str, tuple[Member, float]] = {}
        """By id: the member, and the time of its last message on the clock of `_listening`."""
        self._listened = 0.0, time.monotonic()
        """The clock of `_listening` at the last check, and when that was."""
        self._held_back: dict[str, tuple[frozenset[Entry], float]] = {}
        """By member: its new services, and until when at most they are hidden: see `settle`."""
        self._changes = 0
        self._noting = threading.Lock()

    def version(self) -> int:
        return super().version() + self._changes

    def find(self, role: str, channel: str) -> list[Found]:
        near = super().find(role, channel)
        far = [found for member, _ in list(self._far.values()) for found in member.facing(role, channel)]
        return near + [found for found in far if found.entry not in self._held_back_of(found.member.id)]

    def alive(self, member_id: str) -> bool:
        if "@" not in member_id:
            return super().alive(member_id)
        heard = self._far.get(member_id)
        return heard is not None and self._listening() - heard[1] < SILENT

    def responds(self, member: Member, within: float) -> bool:
        if "@" not in member.id:
            return super().responds(member, within)
        heard = self._far.get(member.id)
        return heard is not None and self._listening() - heard[1] < within

    def listen(self) -> None:
        """To be called about every `SILENT / 4` seconds, before received messages are read."""
        self._listened = self._listening(), time.monotonic()

    def _listening(self) -> float:
        """A clock that stops while this process is delayed, since messages of that time may still be unread."""
        listened, when = self._listened
        return listened + min(time.monotonic() - when, _BEAT)

    def hear(self, member: Member) -> bool:
        """Note the record of a remote member; whether it is new or has changed."""
        with self._noting:
            known = self._far.get(member.id)
            if known is None and len(self._far) >= _MOST:
                return False
            news = known is None or known[0] != member
            if news:
                entries = sum(len(each.entries) for each, _ in self._far.values() if each.id != member.id)
                if entries + len(member.entries) > MOST_ENTRIES:
                    return False
                self._hold_back(member, known[0].entries if known else ())
            self._far[member.id] = member, self._listening()
            self._changes += news
        return news

    def settle(self, connected: Callable[[str], bool]) -> bool:
        """Reveal new services of members whose topics are connected by now; whether any are still hidden.

        So no publication is missed that a server sends in response to a call or command.
        """
        for member_id, (_, end) in list(self._held_back.items()):
            if time.monotonic() >= end or connected(member_id):
                with self._noting:
                    self._held_back.pop(member_id, None)
                    self._changes += 1
        return bool(self._held_back)

    def _hold_back(self, member: Member, known: tuple[Entry, ...]) -> None:
        fresh = {entry for entry in member.entries if entry.role in _SERVING and entry not in known}
        if fresh:
            fresh |= self._held_back_of(member.id)
            self._held_back[member.id] = frozenset(fresh), time.monotonic() + _SETTLING

    def _held_back_of(self, member_id: str) -> frozenset[Entry]:
        return self._held_back.get(member_id, (frozenset(), 0.0))[0]

    def lose(self, gone: Callable[[Member], bool]) -> None:
        """Forget the remote members for which `gone` is true, and those that have been silent for too long."""
        with self._noting:
            for member, _ in list(self._far.values()):
                if gone(member) or not self.alive(member.id):
                    del self._far[member.id]
                    self._held_back.pop(member.id, None)
                    self._changes += 1

    def deny(self, member_id: str, role: str, channel: str) -> None:
        """A remote member has stopped this service; its record is outdated."""
        with self._noting:
            if member_id not in self._far:
                return
            member, when = self._far[member_id]
            gone = [entry for _, entry in member.facing(role, channel)]
            if gone:
                self._far[member_id] = replace(member, entries=tuple(e for e in member.entries if e not in gone)), when
                self._changes += 1

    @property
    def has_far_ones(self) -> bool:
        return bool(self._far)


def record(member_id: str, owner: str, pid: int, entries: Iterable[Entry]) -> bytes:
    """The record of a member, as sent to others."""
    told = {"id": member_id, "owner": owner, "pid": pid, "entries": list(map(told_of, entries))}
    return json.dumps(told).encode()


def read_record(data: bytes, name: str, *, at: str, rights: Rights) -> Member:
    """The member of a record, under the name `name`, reached at address `at` if there is one. Raises DecodeError.

    Entries that it has no right to are left out.
    """
    if len(data) > _LONGEST:
        raise DecodeError(f"the record of {name} is too large: {len(data)} octets")
    try:
        told = json.loads(data)
        member = member_of(told, f"{name}@{told['id']}")
    except (ValueError, TypeError, KeyError, RecursionError) as exc:
        raise DecodeError(f"the record of {name} is malformed: {exc!r}") from exc
    roles = (*_WANTING, *_OFFERING) if at else _WANTING
    allowed = [each for each in member.entries if each.role in roles and rights.allow(each.channel)]
    entries = (_reached(each, at) if each.role in _OFFERING else each for each in allowed)
    return replace(member, entries=tuple(each for each in entries if each))


def _reached(entry: Entry, at: str) -> Entry | None:
    if entry.role != "publishes":
        return replace(entry, address=at)
    if not _ADDRESS.fullmatch(entry.address):
        return None  # only for members on its own host
    return replace(entry, address=f"tcp://{host_of(at)}:{entry.address.rpartition(':')[2]}")


class Inquirer:
    """Requests the record of the transport at one address."""

    def __init__(
        self,
        reactor: Reactor,
        directory: Neighbours,
        owner: str,
        name: str,
        address: str,
        secure: tuple[Secure | None, Rights],
        record: Callable[[Rights], bytes],
    ) -> None:
        """`name` is ours for that transport. `secure` tells how to secure the connection, and what the transport has a
        right to. `record` returns our own record with the entries of which others have a right to know."""
        self.name, self.address = name, address
        self._reactor, self._directory, self._owner, self._record = reactor, directory, owner or "zeromq", record
        self.secure, self._rights = secure
        self._client, self._sequence = random_id(), 0
        self._asked = self._answered = time.monotonic() - _USUAL
        self._told = ""
        """The reason that was logged since the last reply."""
        self._id = ""
        self._why = _NO_REPLY
        options = to_far(address) | {"SNDHWM": 4, "RCVHWM": 16, "RECONNECT_IVL_MAX": 0}
        self._socket = reactor.socket(zmq.DEALER, self._on_answer, self.secure, **options)
        reactor.watch(self._socket, told=self._on_event)
        with as_transport_error(f"connecting to {address}"), self._socket.lock:
            self._socket.raw.connect(address)

    @property
    def knows(self) -> bool:
        """Whether it has ever received a reply."""
        return bool(self._id)

    def tick(self) -> float:
        """Send a request if one is due; seconds until the next one."""
        now = time.monotonic()
        wait = self._asked + (_USUAL if self._answered >= self._asked else _EAGER) - now
        if wait <= 0:
            self._ask()
            wait = _EAGER
        why = self._why  # once: the guard's thread sets it
        untold = self._told in ("", _NO_REPLY, _NO_MORE) and why != self._told  # it may become known later
        if untold and now - self._answered > _UNANSWERED:
            self._told = why
            self._reactor.do(self._tell)  # on another thread, since it may take a while
        return wait

    def _tell(self) -> None:
        """Log why there is no reply."""
        if not self._told:
            return  # there is one by now
        if self.secure is None and self._why in (_NO_REPLY, _NO_MORE) and mechanism_at(self.address) == b"CURVE":
            self._why = _NEEDS_KEYS
        self._told = why = self._why
        log.warning("%s: %s at %s (%s)", self._owner, why, self.address, self.name)

    def ask_now(self) -> None:
        """Send a request at the next tick, since our record has changed."""
        self._asked = 0.0

    def _ask(self) -> None:
        self._asked = time.monotonic()
        self._sequence += 1
        header = pack_request(Flag.IDEMPOTENT, 0, self._client, self._sequence, SILENT)
        self._socket.send(joined(DIRECTORY + header, [self._record(self._rights)]))

    def _on_answer(self, socket: Socket) -> list[Job]:
        while (frames := socket.receive()) is not None:
            try:
                header, payload = read_reply_frames(frames)
                if header.client != self._client or not payload:
                    continue
                member = read_record(bytes(payload[0]), self.name, at=self.address, rights=self._rights)
            except DecodeError as exc:
                log.warning("%s: %s", self.address, exc)
                continue
            self._answered = time.monotonic()
            if self._told:
                log.info("%s: %s answers again", self._owner, self.name)
            self._told, self._why = "", _NO_MORE
            if self._id != member.id:  # it was started again
                self._directory.lose(partial(_is, self._id))
                self._id = member.id
            if self._directory.hear(member):
                self._reactor.within(0.0)
        return []

    def _on_event(self, event: list[bytes]) -> None:
        number, _ = struct.unpack("=hi", event[0])
        if number == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            self._why = "our key is not admitted"
        elif number == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL and self.secure is None:
            self._why = _NEEDS_KEYS
        elif number == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL:
            self._why = "the server does not have the key that we know"
        elif self.secure is not None:
            self._why = "the server does not use CURVE"


def mechanism_at(address: str) -> bytes:
    """The security mechanism of the ZeroMQ socket at an address; empty if it does not answer.

    A server with keys closes a connection without keys at once, often before ZeroMQ has read why. To the first half of
    a greeting it answers with all of its own.
    """
    host, _, port = address.removeprefix("tcp://").rpartition(":")
    with contextlib.suppress(OSError), socket.create_connection((host.strip("[]"), int(port)), _PROBING) as connection:
        connection.sendall(_HALF_A_GREETING)
        greeting = b""
        while len(greeting) < _GREETING and (part := connection.recv(_GREETING - len(greeting))):
            greeting += part
        return greeting[_MECHANISM].rstrip(b"\0")
    return b""


def _is(member_id: str, member: Member) -> bool:
    return member.id == member_id


class FarStream:
    """The counterpart of `zmtp.Stream` for TCP: a connection for one thread. It reconnects by itself."""

    def __init__(self, reactor: Reactor, address: str, secure: Secure | None) -> None:
        assert reactor.guard  # of every transport that connects
        self._guard = reactor.guard
        self._socket = new_socket(reactor.context, zmq.DEALER, secure, **(to_far(address) | {"LINGER": 0}))
        with contextlib.ExitStack() as undo:
            undo.callback(self._socket.close)
            self._watched = self._guard.watch(self._socket, Kind.MESSAGES)
            undo.callback(self._guard.forget, self._watched)
            with as_transport_error(f"connecting to {address}"):
                self._socket.connect(address)
            undo.pop_all()

    def readable(self, seconds: float) -> bool:
        with as_transport_error("receiving"):
            return bool(self._socket.poll(max(1, int(seconds * 1000))))

    def send(self, frames: Frames, wait: Wait) -> None:
        while True:
            with as_transport_error("sending"):
                try:
                    return send_frames(self._socket, frames, int(zmq.NOBLOCK))
                except zmq.Again:
                    self._socket.poll(SLICE_MS, zmq.POLLOUT)
            wait()

    def receive(self) -> Frames:
        """Raises BlockingIOError if nothing came for a slice of time."""
        with as_transport_error("receiving"):
            if not self._socket.poll(SLICE_MS):
                raise BlockingIOError
            frames = receive_frames(self._socket, int(zmq.NOBLOCK))
            self._watched.took(frames)
            return frames

    def close(self) -> None:
        self._guard.forget(self._watched)
        self._socket.close()


class FarFeed:
    """The counterpart of `zmtp.Feed` for TCP: a subscription, which never waits."""

    def __init__(
        self, reactor: Reactor, address: str, topics: Iterable[bytes], secure: Secure | None, depth: int
    ) -> None:
        assert reactor.guard  # of every transport that connects
        self.more, self._guard = False, reactor.guard
        options = to_far(address) | {"LINGER": 0, "RCVHWM": depth}
        self._socket = new_socket(reactor.context, zmq.SUB, secure, **options)
        with contextlib.ExitStack() as undo:
            undo.callback(self._socket.close)
            self._watched = self._guard.watch(self._socket, Kind.MESSAGES, queue=depth)
            undo.callback(self._guard.forget, self._watched)
            with as_transport_error(f"connecting to {address}"):
                for each in topics:
                    self._socket.setsockopt(zmq.SUBSCRIBE, each)
                self._socket.connect(address.partition("#")[0])
            undo.pop_all()

    def fileno(self) -> int:
        return int(self._socket.FD)

    def receive(self) -> Frames:
        """Raises BlockingIOError if there is nothing."""
        with as_transport_error("receiving"):
            try:
                frames = receive_frames(self._socket, int(zmq.NOBLOCK))
            except zmq.Again:
                self.more = False
                raise BlockingIOError from None
            self._watched.took(frames)
            self.more = bool(int(self._socket.get(zmq.EVENTS)) & int(zmq.POLLIN))
            return frames

    def receive_whole(self, messages: list[Frames], most: int) -> bool:
        """Adds nothing: the library returns messages one by one."""
        return self.more

    def close(self) -> None:
        self._guard.forget(self._watched)
        self._socket.close()
