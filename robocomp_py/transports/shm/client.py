"""Callers and command outlets."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING

from ...errors import DecodeError, Timeout
from ...wire.codec import Payload
from ...wire.header import Flag, pack_request, reply_at
from ..base import STATUSES, Channel, Reply, Status, answered
from ..client import CallingLink, CommandingLink, FindingLink
from ..link import accepted, persist
from ..members import Entry, Member
from .early_wakeup import EarlyWakeup
from .peer import Peer
from .queues import WAKE_EARLY
from .samples import HEAD_BYTES, Message, size_of

if TYPE_CHECKING:
    from .core import ShmCore


_COMMAND = Flag.ONEWAY | Flag.SENT

_QUICK = 64 * 1024
"""Octets of a request above which its server is not woken early: writing it takes longer than waking up."""


class AskingLink(FindingLink["ShmCore", Peer, int]):
    def reach(self, member: Member, entry: Entry) -> Peer | None:
        return self.transport.peer(member)

    def where(self, entry: Entry) -> int:
        return int(entry.address)

    def request(self, flags: int, remaining: float, number: int = 0) -> tuple[int, bytes]:
        """A new request, or a repetition of `number`; returns its number and its header."""
        number = number or next(self._sequence)
        return number, pack_request(flags, self.channel.type.fingerprint, self.client, number, remaining)


class CommandOutlet(CommandingLink["ShmCore", Peer, int], AskingLink):
    def command(self, peer: Peer, where: int, payload: Payload, end: float, deadline: float) -> None:
        _, header = self.request(_COMMAND, deadline)
        peer.unsettled = True
        send = partial(peer.sender.send, 0, where, header, payload, size_of(payload))
        if not persist(send, end, partial(self.still, peer), self.closed):
            self.still(peer)
            raise Timeout(
                f"{self.channel.name}: its server did not take the command for {deadline:g} s{peer.sender.hindrance}"
            )


class Caller(CallingLink["ShmCore", Peer, int], AskingLink):
    def __init__(self, transport: ShmCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._flags |= Flag.SENT
        self._early_wakeup = EarlyWakeup()

    def open(self) -> None:
        self.transport.dispatcher.callers[self.client] = self
        super().open()

    def release(self) -> None:
        self.transport.dispatcher.callers.pop(self.client, None)
        super().release()

    def post(self, peer: Peer, where: int, payload: Payload, number: int, end: float, deadline: float) -> bool:
        _, header = self.request(self._flags, deadline, number)
        send = partial(peer.sender.send, 0, where, header, payload, size_of(payload))
        return persist(send, end, partial(self.still, peer), self.closed)

    def late_to_ask(self, peer: Peer, deadline: float) -> Timeout:
        return Timeout(f"{super().late_to_ask(peer, deadline)}{peer.sender.hindrance}")

    def ask_peer(self, peer: Peer, where: int, payload: Payload, number: int, end: float, deadline: float) -> Reply:
        line, trial, begun = peer.take(self.channel.name), self._early_wakeup, time.monotonic()
        try:
            at, early = line.number, trial.next()
            size = size_of(payload)
            if early:
                at |= WAKE_EARLY
                if size < _QUICK:
                    peer.sender.announce()
            number, header = self.request(self._flags, max(0.0, end - begun), number)
            if not peer.sender.send(at, where, header, payload, size):
                send = partial(peer.sender.send, at, where, header, payload, size)
                if not persist(send, end, partial(self.still, peer), self.closed):
                    raise self.late_to_ask(peer, deadline)
            while True:
                left = end - time.monotonic()
                if left <= 0:
                    raise self.no_answer(deadline)
                woken = line.woken(left)
                while (message := line.read()) is not None:
                    if (reply := self._reply_in(message, number)) is not None:
                        if trial.trying:
                            trial.took(early, time.monotonic() - begun)
                        return reply if reply.status is Status.OK else accepted(self.channel, reply)
                if not woken:
                    self.still(peer)
        finally:
            peer.give(line)

    def _reply_in(self, message: Message, number: int) -> Reply | None:
        """The reply to this request, if that is what a message is."""
        try:
            found = reply_at(message.octets, HEAD_BYTES)
            if found.sequence == number and found.client == self.client:
                return answered((STATUSES[found.status], message.payload))
        except DecodeError as exc:
            self.malformed(exc)
        except KeyError as exc:
            self.malformed(f"status {exc}")
        return None
