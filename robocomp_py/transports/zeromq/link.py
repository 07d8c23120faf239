"""What all ends of channels have in common: the directory, where they are announced and look for those they face."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from typing import TYPE_CHECKING

from ...contract.qos import traits
from ...errors import (
    Closed,
    ContractMismatch,
)
from ..base import (
    Channel,
    Statistics,
    TypeRef,
    mismatch,
)
from ..directory import Entry, Member

if TYPE_CHECKING:
    from .transport import ZeroMQTransport

log = logging.getLogger("robocomp.transport.zeromq")


TICK = 0.05
"""Seconds between two looks at those we wait for, and into the directory if nobody tells when it changes."""


class Link:
    """One end of a channel: announced in the directory, and looking there for those it faces."""

    role: str
    facing: str

    def __init__(self, transport: ZeroMQTransport, channel: Channel) -> None:
        self.transport, self.channel = transport, channel
        self.stats = Statistics()
        self.closed = threading.Event()
        self._closing = threading.Lock()
        self._entry: Entry | None = None
        self._reported: set[object] = set()

    def open(self) -> None:
        self.announce()

    def tick(self) -> float | None:
        """Do what is due; seconds until the next time, if something will be."""
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
                return True
            if time.monotonic() >= end:
                return False
            self.closed.wait(min(0.005, max(0.0, end - time.monotonic())))

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
        offered = traits(self.channel.qos)
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
        if who not in self._reported:
            self._reported.add(who)
            log.error("%s", mismatch(self.channel, other))
            self.stats.mismatched += 1

    def malformed(self, why: object) -> None:
        """Count a message that is none of ours; the first one is logged."""
        if self.stats.malformed == 0:
            log.warning("%s: dropped a malformed message (further ones are only counted): %s", self.channel.name, why)
        self.stats.malformed += 1
