"""The base of transports whose links find each other in the directory of the run-time folder."""

from __future__ import annotations

import contextlib
import time
from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path
from typing import Any, Protocol, TypeVar

from ..contract.qos import traits
from ..wire.header import clock
from .base import Channel, SupportsGathering
from .directory import Directory
from .limits import IDLE_TICK, ROLL_CALL
from .link import BaseLink, BaseTransport, L, R
from .members import Entry, Found
from .membership import Membership

_SERVING = ("serves", "receives")


class Reached(Protocol):
    """A server process, as its clients see it."""

    id: str
    closed: bool

    @property
    def key(self) -> Hashable:
        """Identifies it in pending calls."""
        ...

    def alive(self) -> bool: ...

    def close(self) -> None: ...


class DirectoryTransport(BaseTransport[Found], SupportsGathering):
    """Such a transport. The thread that receives for its links also has them look for peers."""

    directory: Directory
    member: Membership
    served: Path
    """The folder of the claims, which tells which component serves what."""

    def __init__(self) -> None:
        super().__init__()
        self.gathers = False
        """Whether more links are about to be opened or closed."""
        self._known = -1
        """The newest version of the directory that all links have seen."""
        self._call_at = 0.0
        """When to check next whether known peers still live."""
        self._peers: dict[Hashable, Any] = {}
        """The server processes in use, by key."""

    @abstractmethod
    def look_soon(self) -> None:
        """Have the receiving thread run `tick` now."""

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
        """The server process with that key; created by `make` if it is not known yet."""
        with self._lock:
            self.check_open()
            if key not in self._peers:
                self._peers[key] = make()
            found: R = self._peers[key]
            return found

    def drop(self, peer: Reached) -> None:
        """The process is dead and will send no reply: forget it."""
        with self._lock:
            if self._peers.get(peer.key) is peer:  # a new one may have the same key
                del self._peers[peer.key]
        peer.close()

    def close_peers(self) -> None:
        with contextlib.ExitStack() as everything:
            for peer in self.known_peers():
                everything.callback(peer.close)

    def known_peers(self) -> list[Any]:
        with self._lock:
            return list(self._peers.values())

    def drop_the_dead(self) -> None:
        """Release what is held for processes that have ended."""
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
        """Whether it is time to check whether known peers still live."""
        due = version != self._known or time.monotonic() >= self._call_at
        if due:
            self._call_at = time.monotonic() + ROLL_CALL
        return due

    def _open(self, make: Callable[[], L]) -> L:
        link = super()._open(make)
        if not self._guarded(link.look, False):  # a peer that came meanwhile may have been missed
            self._known = -1
            self.look_soon()
        return link

    def _look_after(self, version: int) -> list[float]:
        """Have links look into the directory, if its version is new, and tick; seconds until the next time."""
        if version != self._known:
            self._known = version  # before the look: another thread that wants a further one sets it to -1 meanwhile
            if not self.look_at_peers():
                self._known = -1
        return self.tick_links()


T = TypeVar("T", bound=DirectoryTransport)


class DirectoryLink(BaseLink[T, Found]):
    """A link that is announced in the directory and finds its peers there."""

    marks = ""
    """Letters for further traits, appended to those of its QoS."""

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
