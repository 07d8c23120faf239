"""The base class of the links."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from typing import TYPE_CHECKING

from cyclonedds.core import Policy

from ...contract.interface import Pattern
from ...contract.qos import traits
from ...wire.names import ANY
from ..base import (
    Channel,
    about_to_block,
)
from ..link import BaseLink
from ..members import Entry
from .endpoints import Endpoint, Said, user_data

if TYPE_CHECKING:
    from .core import DDSCore

log = logging.getLogger("robocomp.transport.dds")

INTAKE = 2000
"""Maximum number of samples taken from a reader at once; more than arrive during one pass of the loop."""

STRANGERS = 100
"""Maximum number of foreign topics, or of peers with another contract, that a link handles."""

DISCOVERY_PAUSE = 0.02
"""Seconds between two checks while DDS has not finished connecting endpoints."""


class Link(BaseLink["DDSCore", Endpoint]):
    """One end of a channel, announced by its reader or writer, which DDS discovers."""

    def __init__(self, transport: DDSCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.bus = transport.bus
        self.id = transport.new_id()
        self._entry: Entry | None = None
        """The announcement of this end of a topic in the run-time folder."""
        self._looking = threading.RLock()
        self._announced: set[str] = set()
        """The channels of peers with another contract that see this link announced; protected by `_looking`."""

    def opened(self) -> None:
        if self.channel.pattern is Pattern.PUBLISH:
            self._entry = self.transport.announce_here(self.role, self.channel, self.id)
        self.look()  # finds earlier peers; later ones are reported to all links

    def look(self) -> bool:
        with self._looking:
            if not self.closed.is_set():
                there = self.counterparts()
                self._announce()
                self.peers_changed(there)
        self.has_news()
        return True

    def peers_changed(self, there: list[Endpoint]) -> None:
        """Handle a change; `there` are all visible peers with our contract."""

    def connected(self) -> bool:
        return self.transport.has_discovered and self.expected() <= self.reached()

    def expected(self) -> set[int]:
        """The ids of the ends that this end of a topic faces, as far as DDS or the run-time folder reports them."""
        return {endpoint.id for endpoint in self.counterparts()} | self.transport.announced_here(
            self.facing, self.channel
        )

    def reached(self) -> set[int]:
        """The ids of the peers that DDS has connected with this end of a topic."""
        return set()

    def withdraw(self) -> None:
        self.transport.drop_id(self.id)
        if self._entry:
            self.transport.withdraw_here(self._entry)
        with self._looking:  # wait for a running `look`, which may announce
            pass
        with contextlib.ExitStack() as everything:
            for name in self._announced:
                everything.callback(self.transport.announcing.remove, (self.id, name))

    def about(self, role: str = "", channel: str = "") -> Policy.Userdata:
        return user_data(self.said(role, channel))

    def said(self, role: str = "", channel: str = "") -> Said:
        kind = self.channel.type
        return {
            "role": role or self.role,
            "channel": channel or self.channel.name,
            "fingerprint": kind.fingerprint,
            "text": kind.text,
            "id": self.id,
            "reliable": self.channel.qos.reliable,
            "latched": self.channel.qos.latched,
            "traits": traits(self.channel.qos),
            "owner": self.transport.owner,
            "pid": os.getpid(),
        }

    def _announce(self) -> None:
        """If the channel has `*`, announce this link to peers with another contract: they see no endpoint of it."""
        if ANY not in self.channel.name:
            return
        mine = self.channel.type.fingerprint
        others = dict.fromkeys(endpoint.channel for endpoint in self.faced() if endpoint.fingerprint != mine)
        strangers = set(list(others)[:STRANGERS])
        for name in self._announced - strangers:
            self.transport.announcing.remove((self.id, name))
        for name in strangers - self._announced:
            self.transport.announcing.add((self.id, name), self.said(channel=name))
        self._announced = strangers


def enter(link: Link, order: threading.Lock, deadline: float) -> None:
    """Take the lock for sending. Another thread may hold it until its own deadline."""
    if order.acquire(blocking=False):
        return
    about_to_block()  # the other thread may wait for input that this thread receives
    link.take_turn(order, deadline)
