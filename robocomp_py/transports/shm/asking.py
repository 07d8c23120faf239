"""Who commands and who calls, and the processes they ask."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Hashable
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING

from ...errors import Closed, ContractMismatch, DecodeError, Timeout, TransportError, Unreachable
from ...wire.codec import Payload
from ...wire.header import Flag, ReplyHeader, pack_request, random_id, reply_at
from ..base import STATUSES, Channel, Reply, Status, TypeRef, answered, mismatch
from ..directory import Entry, Member
from ..finding import CommandingLink, FindingLink
from ..pending import Pending
from ..replies import Numbered
from .haste import Haste
from .loop import TICK
from .mail import HURRY, KNOCK, Line, Post, packed, persist
from .samples import HEAD_BYTES, size_of

if TYPE_CHECKING:
    from .transport import ShmTransport


_COMMAND = Flag.ONEWAY | Flag.SENT

_QUICK = 64 * 1024
"""Octets from which on writing a request takes longer than being woken: its server would wait once more."""


class Peer:
    """A transport that serves: the way into its queue, and lines for synchronous calls to it."""

    def __init__(self, transport: ShmTransport, member: Member) -> None:
        self.id, self.key = member.id, packed(member.id)
        self.closed = False
        self.unsettled = False
        """Whether a command was sent that may not have been taken yet."""
        self._transport = transport
        self._idle: list[Line] = []
        self.post = Post(transport.node, packed(transport.member.id), member.id, 0)

    def alive(self) -> bool:
        return not self.closed and self._transport.directory.alive(self.id)

    def take(self) -> Line:
        """A line for the calling thread alone; it must `give` it back."""
        if self.closed:
            raise Unreachable(f"{self.id}: this server left")
        if self._idle:
            try:
                return self._idle.pop()
            except IndexError:  # another thread was quicker
                pass
        return self._transport.new_line()

    def settle(self, end: float) -> None:
        """Wait until all commands were taken. What is on its way to somebody who has not yet looked goes when we go."""
        if not self.unsettled or not self.alive():
            return
        line = self.take()
        try:
            number = random_id()
            header = pack_request(Flag.NONE, 0, 0, number, max(0.0, end - time.monotonic()))
            knock = partial(self.post.send, line.number, KNOCK, header, b"", 0)
            if not persist(knock, end, lambda: None, threading.Event()):
                return
            while time.monotonic() < end and self.alive():
                line.rung(end - time.monotonic())
                while (message := line.read()) is not None:
                    if reply_at(message.octets, HEAD_BYTES).sequence == number:
                        return
        finally:
            self.give(line)

    def give(self, line: Line) -> None:
        self._idle.append(line)
        if self.closed:
            self._close_idle()

    def close(self) -> None:
        self.closed = True
        self._close_idle()
        self.post.close()

    def _close_idle(self) -> None:
        """By whoever gets hold of each: more may be given back meanwhile."""
        with contextlib.suppress(IndexError):
            while True:
                self._idle.pop().close()


class AskingLink(FindingLink["ShmTransport", Peer, int]):
    def reach(self, member: Member, entry: Entry) -> Peer | None:
        return self.transport.peer(member)

    def where(self, entry: Entry) -> int:
        return int(entry.address)

    def drop(self, peer: Peer) -> None:
        self.transport.drop(peer)

    def request(self, flags: int, remaining: float, number: int = 0) -> tuple[int, bytes]:
        """A new one, or that of a number which was asked before; its number and its header."""
        number = number or next(self._sequence)
        return number, pack_request(flags, self.channel.type.fingerprint, self.client, number, remaining)


class CommandOutlet(CommandingLink["ShmTransport", Peer, int], AskingLink):
    def command(self, peer: Peer, where: int, payload: Payload, end: float, deadline: float) -> None:
        _, header = self.request(_COMMAND, deadline)
        peer.unsettled = True
        send = partial(peer.post.send, 0, where, header, payload, size_of(payload))
        if not persist(send, end, partial(self.still, peer), self.closed):
            self.still(peer)
            raise Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")


class Caller(AskingLink):
    role, facing = "calls", "serves"

    def __init__(self, transport: ShmTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._pending = Pending(channel.name)
        self._flags = Flag.IDEMPOTENT | Flag.SENT if channel.idempotent else Flag.SENT
        self._haste = Haste()
        self._met: dict[str, Peer] = {}
        """Those we asked, and who may still answer."""

    def open(self) -> None:
        self.transport.desk.callers[self.client] = self
        super().open()

    def met(self, peer: Peer) -> None:
        self._met[peer.id] = peer

    def question(self, payload: Payload) -> Numbered:
        """What is asked under one number, however often."""
        return Numbered(self, payload, next(self._sequence))

    def call(self, payload: Payload, deadline: float, number: int = 0) -> Future[Reply]:
        self.check_open()
        end = time.monotonic() + deadline
        peer, to = self.server()
        number, header = self.request(self._flags, deadline, number)
        key = peer.key, number
        future = self._pending.add(key, deadline)
        try:
            send = partial(peer.post.send, 0, to, header, payload, size_of(payload))
            sent = persist(send, end, partial(self.still, peer), self.closed)
        except BaseException:
            future.cancel()
            raise
        if not sent:
            self._pending.fail(key, Timeout(f"{self.channel.name}: could not be asked within {deadline:g} s"))
        self.transport.wake()
        return future

    def ask(self, payload: Payload, deadline: float, number: int = 0) -> Reply:
        end = time.monotonic() + deadline
        try:
            while True:
                peer, to = self.server()
                reply = self._ask(peer, to, payload, end, deadline, number)
                if reply.status is not Status.REFUSED or not self.lost(peer):
                    return reply  # else it was not executed, and may be asked for where it is served now
        except TransportError:
            self.check_open()  # what goes wrong because we are closed is that
            raise

    def answered(self, member: int, header: ReplyHeader, payload: Payload) -> None:
        key = member, header.sequence
        try:
            reply = self._understood(Reply(STATUSES[header.status], payload))
        except ContractMismatch as exc:
            self._pending.fail(key, exc)
        except KeyError:
            self.malformed(f"status {header.status}")
        else:
            peer = next((peer for peer in list(self._met.values()) if peer.key == member), None)
            if reply.status is Status.REFUSED and peer and self.lost(peer):
                self._pending.fail(key, Unreachable(f"{self.channel.name}: its server left"))
            else:
                self._pending.settle(key, reply)

    def tick(self) -> float | None:
        wait = self._pending.expire(self.transport.do)
        if len(self._pending):
            left = Unreachable(f"{self.channel.name}: its server left")
            for peer in [peer for peer in list(self._met.values()) if not peer.alive()]:
                self.transport.drop(peer)
                self._pending.fail_all(left, only=partial(_is_to, peer.key), do=self.transport.do)
            wait = TICK if wait is None else min(TICK, wait)
        for peer in [peer for peer in list(self._met.values()) if peer.closed]:
            del self._met[peer.id]
        return wait

    def release(self) -> None:
        super().release()
        self.transport.desk.callers.pop(self.client, None)
        self._pending.close(Closed(f"{self.channel.name}: the link is closed"))

    def _ask(self, peer: Peer, to: int, payload: Payload, end: float, deadline: float, number: int) -> Reply:
        line, haste, begun = peer.take(), self._haste, time.monotonic()
        try:
            at, hurry = line.number, haste.next()
            size = size_of(payload)
            if hurry:
                at |= HURRY
                if size < _QUICK:
                    peer.post.announce()
            number, header = self.request(self._flags, max(0.0, end - begun), number)
            if not peer.post.send(at, to, header, payload, size):
                send = partial(peer.post.send, at, to, header, payload, size)
                if not persist(send, end, partial(self.still, peer), self.closed):
                    raise Timeout(f"{self.channel.name}: could not be asked within {deadline:g} s")
            while True:
                left = end - time.monotonic()
                if left <= 0:
                    raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s")
                rung = line.rung(left)
                while (message := line.read()) is not None:
                    try:
                        found = reply_at(message.octets, HEAD_BYTES)
                        if found.sequence == number and found.client == self.client:
                            reply = answered((STATUSES[found.status], message.payload))
                            if haste.trying:
                                haste.took(hurry, time.monotonic() - begun)
                            return reply if reply.status is Status.OK else self._understood(reply)
                    except DecodeError as exc:
                        self.malformed(exc)
                    except KeyError as exc:
                        self.malformed(f"status {exc}")
                if not rung:
                    self.still(peer)
        finally:
            peer.give(line)

    def _understood(self, reply: Reply) -> Reply:
        if reply.status is Status.MISMATCH:
            text = bytes(reply.payload).decode(errors="replace")
            raise ContractMismatch(mismatch(self.channel, TypeRef("", 0, text)))
        return reply


def _is_to(peer: int, key: Hashable) -> bool:
    """Whether that is the key of a call to that peer."""
    return isinstance(key, tuple) and key[0] == peer
