"""Callers and command outlets, and the server processes they use."""

from __future__ import annotations

import contextlib
import threading
import time
from functools import partial
from typing import TYPE_CHECKING

from ...errors import DecodeError, Timeout, Unreachable
from ...wire.codec import Payload
from ...wire.header import Flag, pack_request, random_id, reply_at
from ..base import STATUSES, Channel, Reply, Status, answered
from ..client import CallingLink, CommandingLink, FindingLink
from ..directory import Entry, Member
from ..link import accepted, persist
from .early_wakeup import EarlyWakeup
from .queues import CONFIRM, WAKE_EARLY, ReplyQueue, Sender, packed
from .receipts import OPENED
from .receipts import Reader as Receiver
from .samples import HEAD_BYTES, size_of

if TYPE_CHECKING:
    from .transport import ShmTransport


_COMMAND = Flag.ONEWAY | Flag.SENT

_QUICK = 64 * 1024
"""Octets of a request above which its server is not woken early: writing it takes longer than waking up."""


class Peer:
    """A server process: its queue for requests, and lines for blocking calls to it."""

    def __init__(self, transport: ShmTransport, member: Member) -> None:
        self.id, self.key = member.id, packed(member.id)
        self.closed = False
        self.unsettled = False
        """Whether a command was sent that may not have been taken yet."""
        self._transport = transport
        self._idle: list[ReplyQueue] = []
        self._stale = 0
        own = packed(transport.member.id)
        opened = Receiver(transport.receipts(member.id, OPENED), own, 0)
        self.sender = Sender(transport.node, own, member.id, 0, opened)
        transport.node.heaps.meet(self.key)  # so that its last replies can still be read after it has left

    def alive(self) -> bool:
        return not self.closed and self._transport.directory.alive(self.id)

    def take(self, asking: str) -> ReplyQueue:
        """A line for the calling thread alone, and what it is asking for; the thread must `give` it back."""
        if self.closed:
            raise Unreachable(f"{asking}: its server left")
        if self._idle:
            try:
                return self._idle.pop()
            except IndexError:  # another thread has taken it
                pass
        return self._transport.new_line()

    def settle(self, end: float) -> None:
        """Wait until all commands were taken: closing discards commands that the server has not read yet."""
        if not self.unsettled or not self.alive():
            return
        line = self.take(self.id)
        try:
            number = random_id()
            header = pack_request(Flag.NONE, 0, 0, number, max(0.0, end - time.monotonic()))
            confirm = partial(self.sender.send, line.number, CONFIRM, header, b"", 0)
            if not persist(confirm, end, lambda: None, threading.Event()):
                return
            while time.monotonic() < end and self.alive():
                line.woken(end - time.monotonic())
                while (message := line.read()) is not None:
                    if reply_at(message.octets, HEAD_BYTES).sequence == number:
                        return
        finally:
            self.give(line)

    def give(self, line: ReplyQueue) -> None:
        self._idle.append(line)
        if self.closed or line.number <= self._stale:  # checked last: `close` and `renew` set these first
            self._close_idle()

    def renew(self, lines: int) -> None:
        """Use no line up to that number any more, since servers may be unable to reach them."""
        self._stale = lines
        self._close_idle()

    def close(self) -> None:
        self.closed = True
        self._close_idle()
        self.sender.close()

    def _close_idle(self) -> None:
        """Close idle lines one by one, since other threads may add or take some meanwhile."""
        with contextlib.suppress(IndexError):
            while True:
                self._idle.pop().close()


class AskingLink(FindingLink["ShmTransport", Peer, int]):
    def reach(self, member: Member, entry: Entry) -> Peer | None:
        return self.transport.peer(member)

    def where(self, entry: Entry) -> int:
        return int(entry.address)

    def request(self, flags: int, remaining: float, number: int = 0) -> tuple[int, bytes]:
        """A new request, or a repetition of `number`; returns its number and its header."""
        number = number or next(self._sequence)
        return number, pack_request(flags, self.channel.type.fingerprint, self.client, number, remaining)


class CommandOutlet(CommandingLink["ShmTransport", Peer, int], AskingLink):
    def command(self, peer: Peer, where: int, payload: Payload, end: float, deadline: float) -> None:
        _, header = self.request(_COMMAND, deadline)
        peer.unsettled = True
        send = partial(peer.sender.send, 0, where, header, payload, size_of(payload))
        if not persist(send, end, partial(self.still, peer), self.closed):
            self.still(peer)
            raise Timeout(
                f"{self.channel.name}: its server did not take the command for {deadline:g} s{peer.sender.hindrance}"
            )


class Caller(CallingLink["ShmTransport", Peer, int], AskingLink):
    def __init__(self, transport: ShmTransport, channel: Channel) -> None:
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
                    try:
                        found = reply_at(message.octets, HEAD_BYTES)
                        if found.sequence == number and found.client == self.client:
                            reply = answered((STATUSES[found.status], message.payload))
                            if trial.trying:
                                trial.took(early, time.monotonic() - begun)
                            return reply if reply.status is Status.OK else accepted(self.channel, reply)
                    except DecodeError as exc:
                        self.malformed(exc)
                    except KeyError as exc:
                        self.malformed(f"status {exc}")
                if not woken:
                    self.still(peer)
        finally:
            peer.give(line)
