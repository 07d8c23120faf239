"""Callers and command outlets."""

from __future__ import annotations

import logging
import time
from functools import partial
from typing import TYPE_CHECKING

from ...errors import (
    DecodeError,
    Timeout,
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
from ..link import accepted, persist
from ..members import Entry, Member
from .frames import Frames, joined, read_reply_frames, topic
from .peer import Peer
from .remote import FarStream
from .sockets import as_transport_error
from .zmtp import SLICE_MS, Gone, Stream

if TYPE_CHECKING:
    from .core import ZeroMQCore  # noqa: F401  # named below, in quotes

log = logging.getLogger("robocomp.transport.zeromq")


_SLICE = SLICE_MS / 1000
"""Seconds after which a waiting call checks whether its server lives and its link is open."""


class AskingLink(FindingLink["ZeroMQCore", Peer, bytes]):
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


class CommandOutlet(CommandingLink["ZeroMQCore", Peer, bytes], AskingLink):
    def command(self, peer: Peer, where: bytes, payload: Payload, end: float, deadline: float) -> None:
        _, frames = self.request(peer, where, Flag.ONEWAY, deadline, payload)
        with as_transport_error(f"sending {self.channel.name}"):
            sent = persist(partial(peer.line.send, frames), end, partial(self.still, peer), self.closed)
        if not sent:
            self.still(peer)
            raise Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")


class Caller(CallingLink["ZeroMQCore", Peer, bytes], AskingLink):
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
