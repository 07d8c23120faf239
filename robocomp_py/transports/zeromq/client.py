"""Callers and command outlets, and the server processes they use."""

from __future__ import annotations

import contextlib
import logging
import time
from functools import partial
from typing import TYPE_CHECKING

import zmq

from ...errors import (
    DecodeError,
    Timeout,
    TransportError,
)
from ...wire.codec import Payload
from ...wire.header import (
    Flag,
    clock,
    pack_request,
)
from ..base import (
    STATUSES,
    Reply,
    Status,
    answered,
)
from ..client import CallingLink, CommandingLink, FindingLink
from ..directory import Entry, Member
from ..leader_followers import Job
from ..link import accepted, persist
from .curve import Secure
from .frames import Frames, joined, read_reply_frames, topic
from .remote import FarStream, is_far, to_far
from .sockets import Socket, as_transport_error
from .zmtp import SLICE_MS, Gone, Stream, Wait

if TYPE_CHECKING:
    from .transport import ZeroMQTransport

log = logging.getLogger("robocomp.transport.zeromq")


_SLICE = SLICE_MS / 1000
"""Seconds after which a waiting call checks whether its server lives and its link is open."""

_GREETINGS = 3
"""Attempts to connect if the server hangs up during the handshake, as it does if this process is delayed."""

_TO_SERVER = {"IMMEDIATE": 1, "RECONNECT_IVL": -1, "SNDHWM": 1000, "RCVHWM": 1000}
"""No queueing for a dead server; one that comes back has another address."""


class Peer:
    """A server process: a shared connection to it, and streams for blocking calls."""

    def __init__(self, transport: ZeroMQTransport, member_id: str, address: str, secure: Secure | None = None) -> None:
        self.id = self.key = member_id
        self._address, self._transport, self._secure = address, transport, secure
        self.closed, self.is_far = False, is_far(address)
        self.flags = Flag.NONE
        """The flags of all requests to it."""
        self.callers: dict[int, Caller] = {}
        self._idle: list[Stream | FarStream] = []
        options = _TO_SERVER | (to_far(address) if self.is_far else {})
        self.line = transport.socket(zmq.DEALER, self._on_reply, secure, **options)
        if self.is_far:
            transport.watch(self.line)
        with as_transport_error(f"connecting to {address}"), self.line.lock:
            self.line.raw.connect(address)

    def alive(self) -> bool:
        return not self.closed and self._transport.directory.alive(self.id)

    def take(self, wait: Wait) -> Stream | FarStream:
        """A stream for the calling thread alone; it must `give` it back, or close it. Raises Gone."""
        try:
            return self._idle.pop()
        except IndexError:
            pass
        if self.closed:
            raise Gone("it was closed")
        if self.is_far:
            return FarStream(self._transport, self._address, self._secure)
        try:
            return self._stream(wait)
        except TransportError:  # from `wait`; some are OSErrors, too
            raise
        except (ConnectionError, FileNotFoundError) as exc:
            raise Gone(str(exc)) from exc
        except OSError as exc:
            raise TransportError(f"zeromq: connecting to {self._address}: {exc.strerror}") from exc

    def _stream(self, wait: Wait) -> Stream:
        path = self._address.removeprefix("ipc://")
        for _ in range(_GREETINGS - 1):
            with contextlib.suppress(Gone):
                return Stream(path, wait)
            wait()
        return Stream(path, wait)

    def give(self, stream: Stream | FarStream) -> None:
        self._idle.append(stream)
        if self.closed:
            self._close_idle()

    def close(self) -> None:
        self.closed = True
        self._close_idle()
        self._transport.forget(self.line)

    def _close_idle(self) -> None:
        """Close idle streams one by one, since other threads may add or take some meanwhile."""
        with contextlib.suppress(IndexError):
            while True:
                self._idle.pop().close()

    def _on_reply(self, socket: Socket) -> list[Job]:
        jobs: list[Job] = []  # callbacks of a Future may take long, or make calls
        while (frames := socket.receive()) is not None:
            try:
                header, payload = read_reply_frames(frames)
            except DecodeError as exc:
                log.warning("%s: dropped a malformed reply: %s", self._address, exc)
                continue
            caller = self.callers.get(header.client)
            if caller:
                jobs.append(partial(caller.answered, self.key, header, payload))
        return jobs


class AskingLink(FindingLink["ZeroMQTransport", Peer, bytes]):
    def reach(self, member: Member, entry: Entry) -> Peer:
        peer = self.transport.peer(member, entry.address)
        peer.flags = Flag.SENT if entry.traits == clock() else Flag.NONE
        return peer

    def where(self, entry: Entry) -> bytes:
        return topic(entry.channel)

    def request(
        self, peer: Peer, channel: bytes, flags: int, remaining: float, payload: Payload, number: int = 0
    ) -> tuple[int, Frames]:
        """A new request, or a repetition of `number`; returns its number and the frames."""
        number = number or next(self._sequence)
        flags |= peer.flags
        header = pack_request(flags, self.channel.type.fingerprint, self.client, number, remaining)
        return number, joined(channel + header, payload)


class CommandOutlet(CommandingLink["ZeroMQTransport", Peer, bytes], AskingLink):
    def command(self, peer: Peer, where: bytes, payload: Payload, end: float, deadline: float) -> None:
        _, frames = self.request(peer, where, Flag.ONEWAY, deadline, payload)
        with as_transport_error(f"sending {self.channel.name}"):
            sent = persist(partial(peer.line.send, frames), end, partial(self.still, peer), self.closed)
        if not sent:
            self.still(peer)
            raise Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")


class Caller(CallingLink["ZeroMQTransport", Peer, bytes], AskingLink):
    def met(self, peer: Peer) -> None:
        super().met(peer)
        peer.callers[self.client] = self

    def release(self) -> None:
        for peer in list(self._met.values()):
            peer.callers.pop(self.client, None)
        super().release()

    def refuses(self, peer: Peer, reply: Reply) -> bool:
        if peer.is_far and not reply.payload:  # its known entries may be outdated
            self.transport.directory.deny(peer.id, self.facing, self.channel.name)
        return super().refuses(peer, reply)

    def post(self, peer: Peer, where: bytes, payload: Payload, number: int, end: float, deadline: float) -> bool:
        _, frames = self.request(peer, where, self._flags, deadline, payload, number)
        with as_transport_error(f"asking {self.channel.name}"):
            return persist(partial(peer.line.send, frames), end, partial(self.still, peer), self.closed)

    def ask_peer(self, peer: Peer, where: bytes, payload: Payload, number: int, end: float, deadline: float) -> Reply:
        def wait() -> None:
            self.still(peer)
            if time.monotonic() >= end:
                raise self.late_to_ask(peer, deadline)

        try:
            stream = peer.take(wait)
            try:
                left = max(0.0, end - time.monotonic())
                number, frames = self.request(peer, where, self._flags, left, payload, number)
                stream.send(frames, wait)
                reply = self._reply(peer, stream, number, end, deadline)
            except BaseException:  # a late reply must not reach the next call on this stream
                stream.close()
                raise
        except Gone as exc:
            self.check_open()  # what goes wrong because we are closed is that
            raise self._left() from exc
        peer.give(stream)
        return reply if reply.status is Status.OK else accepted(self.channel, reply)

    def _reply(self, peer: Peer, stream: Stream | FarStream, number: int, end: float, deadline: float) -> Reply:
        while True:
            frames = self._receive(peer, stream, end, deadline)
            try:
                header, payload = read_reply_frames(frames)
                if header.sequence == number and header.client == self.client:
                    return answered((STATUSES[header.status], payload))
            except DecodeError as exc:
                self.malformed(exc)
            except KeyError as exc:
                self.malformed(f"status {exc}")

    def _receive(self, peer: Peer, stream: Stream | FarStream, end: float, deadline: float) -> Frames:
        while True:
            left = end - time.monotonic()
            if left <= 0:
                raise self.no_answer(deadline)
            try:
                if left < _SLICE and not stream.readable(left):
                    continue
                return stream.receive()
            except BlockingIOError:
                self.still(peer)
