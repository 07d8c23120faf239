"""Who asks one process, the one that serves its channel, and finds it in the directory."""

from __future__ import annotations

import itertools
import threading
import time
from abc import ABC, abstractmethod
from typing import Generic, Protocol, TypeVar

from ..errors import Timeout, Unreachable
from ..wire.codec import Payload
from ..wire.header import random_id
from .announced import AnnouncedLink, T
from .base import Channel
from .directory import Entry, Member


class Reached(Protocol):
    """A process that serves, as those who ask it know it."""

    id: str
    closed: bool

    def alive(self) -> bool: ...


P = TypeVar("P", bound=Reached)
W = TypeVar("W")


class FindingLink(AnnouncedLink[T], ABC, Generic[T, P, W]):
    """`P` is what such a process is to us, `W` what says there that a request is for this channel."""

    def __init__(self, transport: T, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.client, self._sequence = random_id(), itertools.count(1)
        self._found: tuple[P, W] | None = None
        self._found_at = -1
        """The version of the directory in which it was found."""

    @abstractmethod
    def reach(self, member: Member, entry: Entry) -> P | None:
        """A process that serves this channel; None if it has just left."""

    @abstractmethod
    def where(self, entry: Entry) -> W:
        """What requests bear there."""

    @abstractmethod
    def drop(self, peer: P) -> None:
        """It is dead: nobody we wait for there will answer."""

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
        if found and not found[0].closed and not (fresh and self.transport.directory.version() != self._found_at):
            return found
        self.check_open()  # once we are closed nothing is found any more, so it need not be looked at above
        version = self.transport.directory.version()
        self._found = None
        for member, entry in self.counterparts(strict=True):
            peer = self.reach(member, entry) if self.transport.directory.alive(member.id) else None
            if peer is not None:
                found = peer, self.where(entry)
                self.met(peer)
                self._found, self._found_at = found, version
                if self.closed.is_set():  # meanwhile
                    self._found = None
                self.check_open()
                return found
        raise Unreachable(f"{self.channel.name}: nobody serves it")

    def look(self) -> bool:
        there = [(member.id, self.where(entry)) for member, entry in self.counterparts()]
        found = self._found
        if found and (found[0].id, found[1]) not in there:
            self._found = None
        return True

    def lost(self, peer: P) -> bool:
        """Whether a process has stopped serving this channel, as one that refuses a request probably has."""
        self.look()
        return not (self._found and self._found[0] is peer)

    def still(self, peer: P) -> None:
        """Raise if there is no point in waiting any longer."""
        self.check_open()
        if not peer.alive():
            self.drop(peer)
            raise Unreachable(f"{self.channel.name}: its server left")

    def release(self) -> None:
        self._found = None


class CommandingLink(FindingLink[T, P, W], ABC):
    """Who sends one command after the other."""

    role, facing = "commands", "receives"

    def __init__(self, transport: T, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._order = threading.Lock()

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        if not self._order.acquire(timeout=max(0.0, deadline)):
            raise Timeout(f"{self.channel.name}: another thread was still sending after {deadline:g} s")
        try:
            self.check_open()
            peer, where = self.server(fresh=True)  # nobody would tell that it does not serve this any more
            self.command(peer, where, payload, end, deadline)
        finally:
            self._order.release()

    @abstractmethod
    def command(self, peer: P, where: W, payload: Payload, end: float, deadline: float) -> None:
        """Send it there until `end`, which is so many seconds after `send` began."""
