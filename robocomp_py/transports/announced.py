"""Transports whose ends find each other in the directory of the run-time folder: what all of them have in common."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from ..contract.qos import traits
from ..errors import Closed, ContractMismatch
from ..wire.header import clock
from .base import Channel, Statistics, TypeRef, mismatch
from .directory import Directory, Entry, Member, Membership
from .sparing import Sparing

if TYPE_CHECKING:
    from .served import ServingLink

log = logging.getLogger("robocomp.transport")

STRANGERS = 1000
"""So many of those who mean something else are told apart; further ones are not reported any more."""

_AT_FIRST, _SLOWLY = 0.005, 0.05
"""Seconds between two looks for somebody who has not come, and for one who has not come for a while."""

L = TypeVar("L", bound="AnnouncedLink[Any]")
R = TypeVar("R")


_SERVING = ("serves", "receives")


class Announcing(ABC):
    """Such a transport: its links, which the thread that receives for all of them looks after, too."""

    directory: Directory
    member: Membership
    owner: str
    served: Path
    """The folder of the claims: who serves what."""

    def __init__(self) -> None:
        self.closed = False
        self.gathers = False
        """Whether more links are about to be opened or closed."""
        self._lock = threading.RLock()
        self._links: list[AnnouncedLink[Any]] = []
        self._known = -1
        """The version of the directory that all links have seen."""
        self._last: dict[object, str] = {}
        """What last went wrong with looking after a link, so that it is not told at every tick."""

    @abstractmethod
    def enlist(self, link: ServingLink) -> str:
        """Have requests for a link given to it; the address at which they come in."""

    @abstractmethod
    def delist(self, link: ServingLink) -> None:
        """Have no more requests given to it."""

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        """See `base.gathering`."""
        self.gathers = True
        try:
            with self.member.gathered():
                yield
        finally:
            self.gathers = False
            self.look_soon()

    @abstractmethod
    def look_soon(self) -> None:
        """Have the thread that receives look after the links now."""

    def left(self, link: AnnouncedLink[Any]) -> None:
        """A link was closed."""
        with self._lock:
            if link in self._links:
                self._links.remove(link)
            for work in (link.look, link.tick):
                self._last.pop(work, None)

    def _open(self, link: L) -> L:
        if self.closed:
            raise Closed("the transport is closed")
        try:
            link.open()
        except BaseException:
            link.close()
            raise
        with self._lock:
            self._links.append(link)  # only now: those in the list are looked after by the receiving thread
            closed = self.closed
        if closed:
            link.close()
            raise Closed("the transport is closed")
        if not self._guarded(link.look, False):  # who came after it was opened, and before it was in the list
            self._known = -1
        return link

    def _look_after(self, version: int) -> list[float]:
        """Have links look into the directory, which has that version, and tick; seconds until they want to again."""
        links = list(self._links)
        if version != self._known and all([self._guarded(link.look, False) for link in links]):
            self._known = version
        waits = [self._guarded(link.tick, None) for link in links]
        return [wait for wait in waits if wait is not None]

    def _guarded(self, work: Callable[[], R], otherwise: R) -> R:
        """What a link does on the thread that receives for everybody: if it fails, the others go on."""
        try:
            result = work()
        except Exception as exc:
            if self.closed and isinstance(exc, Closed):
                return otherwise
            if self._last.get(work) != repr(exc):
                self._last[work] = repr(exc)
                log.exception("looking after a link; trying again")
            return otherwise
        self._last.pop(work, None)
        return result


T = TypeVar("T", bound=Announcing)


class AnnouncedLink(Generic[T]):
    """One end of a channel: announced in the directory, and looking there for those it faces."""

    role: str
    facing: str

    def __init__(self, transport: T, channel: Channel) -> None:
        self.transport, self.channel = transport, channel
        self.stats = Statistics()
        self.closed = threading.Event()
        self._closing = threading.Lock()
        self._entry: Entry | None = None
        self._patience = _AT_FIRST
        """Seconds until the next look for somebody who has not come yet, however often he is waited for."""
        self._reported: set[object] = set()
        self._sparing = Sparing()

    def open(self) -> None:
        self.announce()

    def tick(self) -> float | None:
        """Do what is due; seconds until the next time, if not a tick."""
        return None

    def look(self) -> bool:
        """The directory has changed. True, or it raises: whoever calls this wants to know that it was done."""
        self.counterparts()
        return True

    def wait_peer(self, timeout: float) -> bool:
        end = time.monotonic() + timeout
        while True:
            self.check_open()
            if self.visible():
                self._patience = _AT_FIRST
                return True
            if time.monotonic() >= end:
                return False
            self.closed.wait(min(self._patience, max(0.0, end - time.monotonic())))
            self._patience = min(1.3 * self._patience, max(_SLOWLY, self.transport.directory.pause / 2))

    def visible(self) -> bool:
        """Whether the other side is there. Raises ContractMismatch if only others are."""
        return any(self.transport.directory.alive(member.id) for member, _ in self.counterparts(strict=True))

    def close(self) -> None:
        with self._closing:
            if self.closed.is_set():
                return
            self.closed.set()
        with contextlib.ExitStack() as everything:
            everything.callback(self.release)
            everything.callback(self.transport.left, self)
            if self._entry:
                everything.callback(self.transport.member.remove, self._entry)

    def release(self) -> None:
        """Let go of what this link holds, which is not everything if it could not be opened; called once."""

    def announce(self, address: str = "") -> None:
        kind = self.channel.type
        offered = clock() if self.role in _SERVING else traits(self.channel.qos)
        self._entry = Entry(self.role, self.channel.name, kind.fingerprint, kind.text, address, offered)
        self.transport.member.add(self._entry)

    def counterparts(self, *, strict: bool = False) -> list[tuple[Member, Entry]]:
        """Those we face who mean the same by the name; the others are reported, once each.

        With `strict`, raises ContractMismatch if there are only others.
        """
        named = [
            (member, entry)
            for member, entry in self.transport.directory.find(self.facing, self.channel.name)
            if entry.channel == self.channel.name or member.id != self.transport.member.id
        ]
        same = [found for found in named if found[1].fingerprint == self.channel.type.fingerprint]
        for member, entry in named:
            if entry.fingerprint != self.channel.type.fingerprint:
                self.report_mismatch((member.id, entry.fingerprint), TypeRef("", entry.fingerprint, entry.text))
        if strict and named and not same:
            entry = named[0][1]
            raise ContractMismatch(mismatch(self.channel, TypeRef("", entry.fingerprint, entry.text)))
        return same

    def check_open(self) -> None:
        if self.closed.is_set() or self.transport.closed:
            raise Closed(f"{self.channel.name}: the link is closed")

    def report_mismatch(self, who: object, other: TypeRef) -> None:
        if who not in self._reported and len(self._reported) < STRANGERS:
            self._reported.add(who)
            if self._sparing.may_tell():
                log.error("%s", mismatch(self.channel, other))
            self.stats.mismatched += 1

    def malformed(self, why: object) -> None:
        """Count a message that is none of ours; the first one is logged."""
        if self.stats.malformed == 0:
            log.warning("%s: dropped a malformed message (further ones are only counted): %s", self.channel.name, why)
        self.stats.malformed += 1
