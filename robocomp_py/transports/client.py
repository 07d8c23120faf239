"""Clients that find the one server of their channel in the directory."""

from __future__ import annotations

import itertools
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Hashable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from functools import partial
from typing import Generic, TypeVar

from ..errors import Closed, ContractMismatch, Timeout, TransportError, Unreachable
from ..wire.codec import Payload
from ..wire.header import Flag, ReplyHeader, random_id
from .base import STATUSES, Channel, Reply, Status, SupportsQuestion
from .directory_transport import DirectoryLink, Reached, T
from .link import accepted
from .members import Entry, Member
from .pending import Pending
from .replies import Numbered

LOOK = 0.05
"""Seconds between two checks whether the peers of pending calls live."""


def client_mark(client: int) -> str:
    """The trait by which servers find the owner of a client."""
    return f"c{client:016x}"


P = TypeVar("P", bound=Reached)
W = TypeVar("W")


class FindingLink(DirectoryLink[T], ABC, Generic[T, P, W]):
    """`P` is the type of a peer, `W` the type of what a request bears so that the peer finds this channel."""

    def __init__(self, transport: T, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.client, self._sequence = random_id(), itertools.count(1)
        self.marks = client_mark(self.client)
        self._found: tuple[P, W, int] | None = None
        """The peer, what requests bear, and the version of the directory in which it was found."""

    @abstractmethod
    def reach(self, member: Member, entry: Entry) -> P | None:
        """A process that serves this channel; None if it has just left."""

    @abstractmethod
    def where(self, entry: Entry) -> W:
        """What requests to that entry bear."""

    def met(self, peer: P) -> None:
        """A server was found."""

    def visible(self) -> bool:
        try:
            peer, _ = self.server(fresh=True)
            self.still(peer)
        except Unreachable:
            return False
        return True

    def server(self, *, fresh: bool = False) -> tuple[P, W]:
        """The process that serves this channel, and what requests bear there. Raises Unreachable.

        It may have stopped doing so since the directory was looked into, unless `fresh`.
        """
        found = self._found
        if found and not found[0].closed and not (fresh and self.transport.directory.version() != found[2]):
            return found[:2]
        self.check_open()  # a closed link finds nothing, so the fast path above need not check
        version = self.transport.directory.version()
        self._found = None
        for member, entry in self.counterparts(strict=True):
            peer = self.reach(member, entry) if self.transport.directory.alive(member.id) else None
            if peer is not None:
                found = peer, self.where(entry), version
                self.met(peer)
                self._found = found
                if self.closed.is_set():  # meanwhile
                    self._found = None
                self.check_open()
                return found[:2]
        raise Unreachable(f"{self.channel.name}: no server")

    def look(self) -> bool:
        there = [(member.id, self.where(entry)) for member, entry in self.counterparts()]
        found = self._found
        if found and (found[0].id, found[1]) not in there:
            self._found = None
        return True

    def lost(self, peer: P) -> bool:
        """Whether a process has stopped serving this channel."""
        self.look()
        found = self._found  # once: another thread may replace it
        return not (found and found[0] is peer)

    def still(self, peer: P) -> None:
        """Raise if the peer is gone or this link is closed, so that waiting is useless."""
        self.check_open()
        if not peer.alive():
            self.transport.drop(peer)
            raise Unreachable(f"{self.channel.name}: its server left")

    def release(self) -> None:
        self._found = None


class CommandingLink(FindingLink[T, P, W], ABC):
    """Sends commands, one at a time."""

    role, facing = "commands", "receives"

    def __init__(self, transport: T, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._order = threading.Lock()

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        self.take_turn(self._order, deadline)
        try:
            self.check_open()
            peer, where = self.server(fresh=True)  # a command has no reply that would report an outdated server
            self.command(peer, where, payload, end, deadline)
        except TransportError:
            self.check_open()  # an error after closing is reported as Closed
            raise
        finally:
            self._order.release()

    @abstractmethod
    def command(self, peer: P, where: W, payload: Payload, end: float, deadline: float) -> None:
        """Send it before `end`, which is `deadline` seconds after `send` began."""


class CallingLink(FindingLink[T, P, W], SupportsQuestion, ABC):
    """Calls end when the peer replies or dies, when their deadline passes, or when they are cancelled."""

    role, facing = "calls", "serves"

    def __init__(self, transport: T, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._pending = Pending(channel.name)
        self._flags = Flag.IDEMPOTENT if channel.idempotent else Flag.NONE
        self._met: dict[Hashable, P] = {}
        """Peers that received a request and may still reply."""

    def ask_peer(self, peer: P, where: W, payload: Payload, number: int, end: float, deadline: float) -> Reply:
        """Send a request with that number (0: a new one) and wait for the reply. Raises TransportError.

        A transport overrides this if a calling thread can receive its reply itself, which saves a change of threads.
        """
        future = self._send(peer, where, payload, number, end, deadline)
        try:
            return future.result(max(0.0, end - time.monotonic()))
        except FutureTimeout:
            future.cancel()
            raise self.no_answer(deadline) from None

    def post(self, peer: P, where: W, payload: Payload, number: int, end: float, deadline: float) -> bool:
        """Send a request; its reply is passed to `answered` later. True once it is sent; False if `end` came first.

        A transport whose library tracks calls itself overrides `call` and `ask_peer` instead.
        """
        raise NotImplementedError

    def met(self, peer: P) -> None:
        self._met[peer.key] = peer

    def question(self, payload: Payload) -> Numbered:
        """A request with one number, however often it is sent."""
        return Numbered(self, payload, next(self._sequence))

    def call(self, payload: Payload, deadline: float, number: int = 0) -> Future[Reply]:
        self.check_open()
        end = time.monotonic() + deadline
        peer, where = self.server()
        future = self._send(peer, where, payload, number, end, deadline)
        self.transport.look_soon()
        return future

    def ask(self, payload: Payload, deadline: float, number: int = 0) -> Reply:
        end = time.monotonic() + deadline
        try:
            while True:
                peer, where = self.server()
                reply = self.ask_peer(peer, where, payload, number, end, deadline)
                if reply.status is not Status.REFUSED or not self.refuses(peer, reply):
                    return reply  # a refused request was not executed, and is sent to the new server
        except TransportError:
            self.check_open()  # an error after closing is reported as Closed
            raise

    def _send(self, peer: P, where: W, payload: Payload, number: int, end: float, deadline: float) -> Future[Reply]:
        number = number or next(self._sequence)
        key = peer.key, number
        future = self._pending.add(key, deadline)
        try:
            sent = self.post(peer, where, payload, number, end, deadline)
        except BaseException as exc:
            future.cancel()
            if isinstance(exc, TransportError):
                self.check_open()  # an error after closing is reported as Closed
            raise
        if not sent:
            if sent is None:
                future.cancel()
                raise TypeError(f"{type(self).__qualname__}.post must return whether it has sent the request, not None")
            self._pending.fail(key, self.late_to_ask(peer, deadline))
        return future

    def refuses(self, peer: P, reply: Reply) -> bool:
        """Whether a process that refuses a request has stopped serving this channel."""
        return self.lost(peer)

    def answered(self, key: Hashable, header: ReplyHeader, payload: Payload) -> None:
        """Take a reply of the peer with that key. Runs callbacks, which may take long."""
        call = key, header.sequence
        try:
            reply = accepted(self.channel, Reply(STATUSES[header.status], payload))
        except ContractMismatch as exc:
            self._pending.fail(call, exc)
        except KeyError:
            self.malformed(f"status {header.status}")
        else:
            peer = self._met.get(key)
            if reply.status is Status.REFUSED and peer and self.refuses(peer, reply):
                self._pending.fail(call, self._left())
            else:
                self._pending.settle(call, reply)

    def tick(self) -> float | None:
        wait = self._pending.expire(self.transport.do)
        if len(self._pending):
            wait = LOOK if wait is None else min(wait, LOOK)
            for peer in [peer for peer in list(self._met.values()) if not peer.alive()]:
                self.transport.drop(peer)
                self._pending.fail_all(self._left(), only=partial(_is_to, peer.key), do=self.transport.do)
        for peer in [peer for peer in list(self._met.values()) if peer.closed]:
            if self._met.get(peer.key) is peer:  # a new one may have the same key
                del self._met[peer.key]
        return wait

    def release(self) -> None:
        super().release()
        self._pending.close(Closed(f"{self.channel.name}: the link is closed"))

    def late_to_ask(self, peer: P, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: the request could not be sent in {deadline:g} s")

    def no_answer(self, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: no answer in {deadline:g} s")

    def _left(self) -> Unreachable:
        return Unreachable(f"{self.channel.name}: its server left")


def _is_to(peer: Hashable, key: Hashable) -> bool:
    """Whether that is the key of a call to that peer."""
    return isinstance(key, tuple) and key[0] == peer
