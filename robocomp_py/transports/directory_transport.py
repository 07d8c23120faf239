"""Transports whose ends find each other in the directory of the run-time folder: what all of them have in common."""

from __future__ import annotations

import contextlib
import time
from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from ..contract.qos import traits
from ..wire.header import clock
from .base import Channel, SupportsGathering
from .directory import Directory, Entry, Found, Membership
from .limits import IDLE_TICK, ROLL_CALL
from .link import BaseLink, BaseTransport, L, R

if TYPE_CHECKING:
    from .server import ServingLink

_SERVING = ("serves", "receives")


class Reached(Protocol):
    """A process that serves, as those who ask it know it."""

    id: str
    closed: bool

    @property
    def key(self) -> Hashable:
        """Names it in the calls that it is to answer."""
        ...

    def alive(self) -> bool: ...

    def close(self) -> None: ...


class DirectoryTransport(BaseTransport[Found], SupportsGathering):
    """Such a transport: its links, which the thread that receives for all of them looks after, too."""

    directory: Directory
    member: Membership
    served: Path
    """The folder of the claims: who serves what."""

    def __init__(self) -> None:
        super().__init__()
        self.gathers = False
        """Whether more links are about to be opened or closed."""
        self._known = -1
        """The version of the directory that all links have seen."""
        self._call_at = 0.0
        """When to look next whether known peers still live."""
        self._peers: dict[Hashable, Any] = {}
        """The processes that are asked, by their keys."""

    @abstractmethod
    def enlist(self, link: ServingLink) -> str:
        """Have requests for a link given to it; the address at which they come in."""

    @abstractmethod
    def delist(self, link: ServingLink) -> None:
        """Have no more requests given to it."""

    @abstractmethod
    def look_soon(self) -> None:
        """Have the thread that receives look after the links now."""

    def find(self, role: str, channel: str) -> list[Found]:
        return self.directory.find(role, channel)

    def is_own(self, peer: Found) -> bool:
        return peer.member.id == self.member.id

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        """See `base.SupportsGathering`."""
        self.gathers = True
        try:
            with self.member.gathered():
                yield
        finally:
            self.gathers = False
            self.look_soon()

    def asked(self, key: Hashable, make: Callable[[], R]) -> R:
        """The process that is asked under that key; it is made if it is not known yet."""
        with self._lock:
            self.check_open()
            if key not in self._peers:
                self._peers[key] = make()
            found: R = self._peers[key]
            return found

    def drop(self, peer: Reached) -> None:
        """The process is dead: nothing we wait for there will be answered."""
        with self._lock:
            self._peers.pop(peer.key, None)
        peer.close()

    def close_peers(self) -> None:
        with contextlib.ExitStack() as everything:
            for peer in self.known_peers():
                everything.callback(peer.close)

    def known_peers(self) -> list[Any]:
        with self._lock:
            return list(self._peers.values())

    def drop_the_dead(self) -> None:
        """Let go of what is held for processes that have ended, whether or not they are asked again."""
        for peer in self.known_peers():
            if not peer.alive():
                self.drop(peer)

    def tick(self) -> float:
        """Do what is due; seconds until the next time."""
        if self.close_if_abandoned():
            return IDLE_TICK
        version = self.directory.version()
        if self.is_roll_call(version):
            self.drop_the_dead()
        return min([IDLE_TICK, *self._look_after(version)])

    def is_roll_call(self, version: int) -> bool:
        """Whether it is time to look whether known peers still live."""
        due = version != self._known or time.monotonic() >= self._call_at
        if due:
            self._call_at = time.monotonic() + ROLL_CALL
        return due

    def _open(self, make: Callable[[], L]) -> L:
        link = super()._open(make)
        if not self._guarded(link.look, False):  # it may have missed a peer that came while it was opened
            self._known = -1
        return link

    def _look_after(self, version: int) -> list[float]:
        """Have links look into the directory, which has that version, and tick; seconds until they want to again."""
        if version != self._known and self.look_at_peers():
            self._known = version
        return self.tick_links()


T = TypeVar("T", bound=DirectoryTransport)


class DirectoryLink(BaseLink[T, Found]):
    """One end of a channel: announced in the directory, and looking there for those it faces."""

    marks = ""
    """Letters behind the traits of its QoS, which say what else it does."""

    def __init__(self, transport: T, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._entry: Entry | None = None

    def open(self) -> None:
        self.announce()

    @property
    def longest_pause(self) -> float:
        return max(super().longest_pause, self.transport.directory.pause / 2)

    def visible(self) -> bool:
        return any(self.transport.directory.alive(member.id) for member, _ in self.counterparts(strict=True))

    def withdraw(self) -> None:
        if self._entry:
            self.transport.member.remove(self._entry)

    def announce(self, address: str = "") -> None:
        kind = self.channel.type
        offered = clock() if self.role in _SERVING else traits(self.channel.qos) + self.marks
        self._entry = Entry(self.role, self.channel.name, kind.fingerprint, kind.text, address, offered)
        self.transport.member.add(self._entry)
