"""Those who are reached by TCP: members of the directory who have no file in our run-time folder.

Who is given `connect` asks at each of these addresses, again and again, who is there and what it offers, and says what
it wants itself; who is given `bind` answers. Each takes the other for a member of its directory as long as it hears
from it, so that links find, miss and understand each other as they do on one machine.

    question, answer      the topic `robocomp/directory` with a request's header, a reply's header; behind it JSON
                          {"id": …, "owner": …, "pid": …, "entries": […]}, as in a file of the directory

What is told of a topic bears the port of its own at the same host: `tcp://*:40123#a1b2c3`.
"""

from __future__ import annotations

import contextlib
import json
import logging
import re
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
from ..directory import Directory, Entry, Found, Member, member_of, told_of
from ..keyfiles import Rights
from ..leader_followers import Job
from .bounds import Kind
from .curve import Secure
from .frames import Frames, joined, read_reply_frames, topic
from .sockets import Socket, as_transport_error, new_socket, receive_frames, send_frames
from .zmtp import SLICE_MS, Wait

if TYPE_CHECKING:
    from .transport import ZeroMQTransport

log = logging.getLogger("robocomp.transport.zeromq")

DIRECTORY = topic("robocomp/directory")

SILENT = 2.0
"""Seconds without a word after which somebody has gone."""

_EAGER, _USUAL = 0.1, 0.5
"""Seconds between two questions, as long as there was no answer, and then."""

_UNANSWERED = 3.0
"""Seconds without an answer after which that is told."""

ACQUAINTED = 0.5
"""Seconds in which those who look for each other at an address have met: a connection is tried every 0.2 s at most."""

_SETTLING = 1.0
"""Seconds for which what a member newly serves is held back, unless we are connected to its topics before."""

_MOST, MOST_ENTRIES = 250, 50_000
"""Members on other hosts that we know, and entries of all of them together: each takes some hundred octets."""

_LONGEST = 1024 * 1024
"""Octets of what somebody tells of itself."""

_SERVING = ("serves", "receives")
_OFFERING, _WANTING = (*_SERVING, "publishes"), ("calls", "commands", "subscribes")

_BEAT = SILENT / 4
"""Seconds between two looks at who is silent; more do not count, since we may have been held up ourselves."""

_AT_FAR = {
    "TCP_KEEPALIVE": 1,
    "TCP_KEEPALIVE_IDLE": 2,
    "TCP_KEEPALIVE_INTVL": 1,
    "TCP_KEEPALIVE_CNT": 3,
    "TCP_MAXRT": 5000,
}
"""The kernel notices a connection that was cut, within five seconds. A silent member is noticed sooner.

ZeroMQ's heartbeats would do the same, but end the process ("Assertion failed: !_io_error", libzmq 4.3.5) if the other
side closes a connection whose messages we do not take for half a second."""

_TO_FAR = {
    "IMMEDIATE": 1,  # no queueing for who is not there
    "RECONNECT_IVL": 100,
    "RECONNECT_IVL_MAX": 400,
    "CONNECT_TIMEOUT": 1000,  # or, after a cut, the system's own patience would have to end first
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
    """Of an address `tcp://HOST:PORT`; empty if it is none."""
    found = _ADDRESS.fullmatch(address)
    return found[1] if found else ""


class Neighbours(Directory):
    """The members of one folder, and those who are heard from."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._far: dict[str, tuple[Member, float]] = {}
        """With the time of its last word, as `_heeded` counts it."""
        self._listened = 0.0, time.monotonic()
        """For how long others could be heard, up to the last look; and when that was."""
        self._held_back: dict[str, tuple[frozenset[Entry], float]] = {}
        """What members newly serve, and until when at most it is not found: see `settle`."""
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
        return heard is not None and self._heeded() - heard[1] < SILENT

    def responds(self, member: Member, within: float) -> bool:
        if "@" not in member.id:
            return super().responds(member, within)
        heard = self._far.get(member.id)
        return heard is not None and self._heeded() - heard[1] < within

    def heed_others(self) -> None:
        """To be called about every `SILENT / 4` seconds, before what has come in is read."""
        self._listened = self._heeded(), time.monotonic()

    def _heeded(self) -> float:
        """Seconds in which we were not held up: what others said meanwhile may still have to be read."""
        heeded, when = self._listened
        return heeded + min(time.monotonic() - when, _BEAT)

    def hear(self, member: Member) -> bool:
        """Note that somebody is there; whether that is news."""
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
            self._far[member.id] = member, self._heeded()
            self._changes += news
        return news

    def settle(self, connected: Callable[[str], bool]) -> bool:
        """Let what members newly serve be found, if we are connected to their topics; whether any are still left.

        So what a server publishes because we have asked it, or commanded it, is heard.
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
        """Forget who is like that, and who has been silent for too long."""
        with self._noting:
            for member, _ in list(self._far.values()):
                if gone(member) or not self.alive(member.id):
                    del self._far[member.id]
                    self._held_back.pop(member.id, None)
                    self._changes += 1

    def deny(self, member_id: str, role: str, channel: str) -> None:
        """Somebody far away does not do this any more; what it said of itself is older."""
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
    """What somebody tells of itself."""
    told = {"id": member_id, "owner": owner, "pid": pid, "entries": list(map(told_of, entries))}
    return json.dumps(told).encode()


def read_record(data: bytes, name: str, *, at: str, rights: Rights) -> Member:
    """Who told that of itself: called NAME, and reached at that address, if we can reach it. Raises DecodeError.

    What it has no right to is left out.
    """
    if len(data) > _LONGEST:
        raise DecodeError(f"{name} tells too much of itself: {len(data)} octets")
    try:
        told = json.loads(data)
        member = member_of(told, f"{name}@{told['id']}")
    except (ValueError, TypeError, KeyError, RecursionError) as exc:
        raise DecodeError(f"{name} tells nothing that makes sense of itself: {exc!r}") from exc
    roles = (*_WANTING, *_OFFERING) if at else _WANTING
    allowed = [each for each in member.entries if each.role in roles and rights.allow(each.channel)]
    entries = (_reached(each, at) if each.role in _OFFERING else each for each in allowed)
    return replace(member, entries=tuple(each for each in entries if each))


def _reached(entry: Entry, at: str) -> Entry | None:
    if entry.role != "publishes":
        return replace(entry, address=at)
    if not _ADDRESS.fullmatch(entry.address):
        return None  # for those on its own machine
    return replace(entry, address=f"tcp://{host_of(at)}:{entry.address.rpartition(':')[2]}")


class Inquirer:
    """Asks at one address who is there."""

    def __init__(self, transport: ZeroMQTransport, name: str, address: str) -> None:
        self.name, self.address = name, address
        self._transport = transport
        self.secure, self._rights = transport.secure_for(name)
        self._client, self._sequence = random_id(), 0
        self._asked = self._answered = time.monotonic() - _USUAL
        self._told = False
        self._id = ""
        self._why = "nobody answers"
        options = to_far(address) | {"SNDHWM": 4, "RCVHWM": 16, "RECONNECT_IVL_MAX": 0}
        self._socket = transport.socket(zmq.DEALER, self._on_answer, self.secure, **options)
        transport.watch(self._socket, told=self._on_event)
        with as_transport_error(f"connecting to {address}"), self._socket.lock:
            self._socket.raw.connect(address)

    @property
    def knows(self) -> bool:
        """Whether it has ever had an answer."""
        return bool(self._id)

    def tick(self) -> float:
        """Ask if it is time to; seconds until it is."""
        now = time.monotonic()
        wait = self._asked + (_USUAL if self._answered >= self._asked else _EAGER) - now
        if wait <= 0:
            self._ask()
            wait = _EAGER
        if not self._told and now - self._answered > _UNANSWERED:
            self._told = True
            log.warning("%s: %s at %s (%s)", self._transport.owner or "zeromq", self._why, self.address, self.name)
        return wait

    def ask_now(self) -> None:
        """What we want has changed."""
        self._asked = 0.0

    def _ask(self) -> None:
        self._asked = time.monotonic()
        self._sequence += 1
        header = pack_request(Flag.IDEMPOTENT, 0, self._client, self._sequence, SILENT)
        self._socket.send(joined(DIRECTORY + header, [self._transport.record(self._rights)]))

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
                log.info("%s: %s answers again", self._transport.owner or "zeromq", self.name)
            self._told, self._why = False, "nobody answers any more"
            if self._id != member.id:  # it was started again
                self._transport.directory.lose(partial(_is, self._id))
                self._id = member.id
            if self._transport.directory.hear(member):
                self._transport.within(0.0)
        return []

    def _on_event(self, event: list[bytes]) -> None:
        number, _ = struct.unpack("=hi", event[0])
        if number == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            self._why = "our key is not admitted"
        elif number == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL and self.secure is None:
            self._why = "this process has no keys, and needs some (start it with --keys FOLDER)"
        elif number == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL:
            self._why = "a server answers that does not have the key that we know"
        elif self.secure is not None:
            self._why = "a server answers that does not use CURVE"


def _is(member_id: str, member: Member) -> bool:
    return member.id == member_id


class FarStream:
    """What `zmtp.Stream` is for a socket in a file: one thread's own way to a server. It reconnects by itself."""

    def __init__(self, transport: ZeroMQTransport, address: str, secure: Secure | None) -> None:
        assert transport.guard  # of every transport that connects
        self._guard = transport.guard
        self._socket = new_socket(transport.context, zmq.DEALER, secure, **(to_far(address) | {"LINGER": 0}))
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
        """Raises BlockingIOError if nothing came for a while."""
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
    """What `zmtp.Feed` is for a socket in a file: a subscription, which never waits."""

    def __init__(
        self, transport: ZeroMQTransport, address: str, topics: Iterable[bytes], secure: Secure | None, depth: int
    ) -> None:
        assert transport.guard  # of every transport that connects
        self.more, self._guard = False, transport.guard
        options = to_far(address) | {"LINGER": 0, "RCVHWM": depth}
        self._socket = new_socket(transport.context, zmq.SUB, secure, **options)
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
        """Nothing is added: the library has them one by one."""
        return self.more

    def close(self) -> None:
        self._guard.forget(self._watched)
        self._socket.close()
