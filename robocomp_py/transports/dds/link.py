"""What all ends of channels have in common: their QoS, and how they look for those they face."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from cyclonedds.core import Policy, Qos

from ...contract.interface import Pattern
from ...contract.qos import History, Liveliness, QoS, traits
from ...wire.names import ANY
from ..base import (
    Channel,
    about_to_block,
    depth_of,
)
from ..directory import Entry
from ..link import BaseLink
from .endpoints import Endpoint, Said, user_data
from .library import BLOCKING_MS
from .limits import UNLIMITED, Limits

if TYPE_CHECKING:
    from .transport import DDSTransport

log = logging.getLogger("robocomp.transport.dds")

INTAKE = 2000
"""The same of those that would pile up in the reader while somebody is slow: more than can come in meanwhile."""

STRANGERS = 100
"""Maximum number of topics of other programs, or of peers with another contract, that a link deals with."""

SOON = 0.02
"""Seconds until the next look at what discovery has not finished."""


_RELIABLE = Policy.Reliability.Reliable(BLOCKING_MS * 1_000_000)


def best_effort_qos(history: Any, *more: Any) -> Qos:
    """For a reader of those who offer no more."""
    return endpoint_qos(history, *more, reliability=Policy.Reliability.BestEffort)


def endpoint_qos(history: Any, *more: Any, reliability: Any = _RELIABLE) -> Qos:
    """What all our endpoints have in common.

    All are reliable on the wire, since a large sample loses fragments even on one host. Samples are
    ordered as they arrive, for clocks may be set back.
    """
    return Qos(
        reliability,
        history,
        Policy.DestinationOrder.ByReceptionTimestamp,
        Policy.DataRepresentation(use_cdrv0_representation=True),
        *more,
    )


def topic_qos(channel: Channel, limits: Limits, *more: Any, common: Callable[..., Qos] = endpoint_qos) -> Qos:
    qos = channel.qos
    more = (*more, *_policies(qos, limits))
    some = 8 if limits.room == UNLIMITED else min(8, limits.room)
    newest = Policy.History.KeepLast(max(depth_of(qos), some))  # for a moment: what waits for a sink is the lane's
    if not qos.latched:
        return common(Policy.History.KeepAll if qos.reliable else newest, *more)
    return common(
        Policy.History.KeepAll if qos.reliable else newest,
        Policy.Durability.TransientLocal,
        Policy.DurabilityService(0, Policy.History.KeepLast(qos.depth), UNLIMITED, UNLIMITED, UNLIMITED),
        *more,
    )


def _policies(qos: QoS, limits: Limits) -> Iterator[Any]:
    """Those that mean the same in DDS."""
    if qos.history is History.KEEP_ALL:
        limits = limits.keeping_all()
    if limits != Limits():
        yield Policy.ResourceLimits(*limits)
    if qos.deadline is not None:
        yield Policy.Deadline(_nanoseconds(qos.deadline))
    if qos.lifespan is not None:
        yield Policy.Lifespan(_nanoseconds(qos.lifespan))
    manual = qos.liveliness is Liveliness.MANUAL_BY_TOPIC
    if qos.lease is not None:
        lives = Policy.Liveliness.ManualByTopic if manual else Policy.Liveliness.Automatic
        yield lives(_nanoseconds(qos.lease))


def _nanoseconds(seconds: float) -> int:
    return max(1, round(seconds * 1e9))


KEEP_ALL = Policy.History.KeepAll


class Link(BaseLink["DDSTransport", Endpoint]):
    """One end of a channel, announced by its reader or writer, which DDS discovers."""

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.bus = transport.bus
        self.id = transport.new_id()
        self._told: Entry | None = None
        """What the others of this host are told of this end of a topic."""
        self._looking = threading.RLock()
        self._shown: set[str] = set()
        """The channels whose ends of another contract are told of us, with the lock of `_looking`."""

    def opened(self) -> None:
        if self.channel.pattern is Pattern.PUBLISH:
            self._told = self.transport.tell_neighbours(self)
        self.look()  # at the peers that were there before; those that come now are reported to all in the list

    def look(self) -> bool:
        with self._looking:
            if not self.closed.is_set():
                there = self.counterparts()
                self._show()
                self.looked(there)
        self.has_news()
        return True

    def looked(self, there: list[Endpoint]) -> None:
        """`there` are those who face us and mean the same."""

    def connected(self) -> bool:
        return self.transport.has_discovered and self.expected() <= self.reached()

    def expected(self) -> set[int]:
        """The ids of the ends that this end of a topic faces, as far as DDS or the run-time folder reports them."""
        return {endpoint.id for endpoint in self.counterparts()} | self.transport.neighbours(self.facing, self.channel)

    def reached(self) -> set[int]:
        """The ids of those with which this end of a topic is connected."""
        return set()

    def withdraw(self) -> None:
        if self._told:
            self.transport.leave_neighbours(self._told)
        with self._looking:  # so that nothing is made any more
            pass
        with contextlib.ExitStack() as everything:
            for name in self._shown:
                everything.callback(self.transport.announcing.remove, (self.id, name))

    def lose(self) -> None:
        """Be closed, in a forked process."""
        self.closed = threading.Event()  # the locks of the former one may be held by threads that are not here
        self.closed.set()

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

    def _show(self) -> None:
        """Announce this link to peers of another contract if it names no instance: they would not see it otherwise."""
        if ANY not in self.channel.name:
            return
        mine = self.channel.type.fingerprint
        others = dict.fromkeys(endpoint.channel for endpoint in self.faced() if endpoint.fingerprint != mine)
        strangers = set(list(others)[:STRANGERS])
        for name in self._shown - strangers:
            self.transport.announcing.remove((self.id, name))
        for name in strangers - self._shown:
            self.transport.announcing.add((self.id, name), self.said(channel=name))
        self._shown = strangers


def enter(link: Link, order: threading.Lock, deadline: float) -> None:
    """Take the lock of those who send by a link, who may hold it until deadlines of their own."""
    if order.acquire(blocking=False):
        return
    about_to_block()  # what they wait for may come in by this very thread
    link.take_turn(order, deadline)
