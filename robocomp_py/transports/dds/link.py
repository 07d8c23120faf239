"""What all ends of channels have in common: their QoS, and how they look for those they face."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from cyclonedds.core import Policy, Qos

from ...contract.qos import History, Liveliness, QoS, traits
from ...errors import (
    Closed,
    ContractMismatch,
    Timeout,
)
from ..base import (
    KEEP_ALL_DEPTH,
    Channel,
    Statistics,
    TypeRef,
    depth_of,
    mismatch,
    step_aside,
)
from ..sparing import Sparing
from .endpoints import Endpoint, Said, user_data
from .library import BLOCKING_MS

if TYPE_CHECKING:
    from .transport import DDSTransport

log = logging.getLogger("robocomp.transport.dds")

BATCH = 32
"""Messages taken from one reader before the others have their turn."""

INTAKE = 2000
"""The same of those that would pile up in the reader while somebody is slow: more than can come in meanwhile."""

STRANGERS = 100
"""So many that mean something else by a channel's name are told about; the others are ignored."""

SOON = 0.02
"""Seconds until the next look at what discovery has not finished."""


_LOOK, _LONGEST_LOOK = 0.002, 0.05
"""Seconds from one look for the other side to the next; more and more, until somebody comes or goes."""


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


def topic_qos(channel: Channel, *more: Any, common: Callable[..., Qos] = endpoint_qos) -> Qos:
    qos = channel.qos
    more = (*more, *_policies(qos))
    newest = Policy.History.KeepLast(max(depth_of(channel.qos), 8))  # for a moment: what waits for a sink is the lane's
    if not qos.latched:
        return common(Policy.History.KeepAll if qos.reliable else newest, *more)
    unlimited = -1
    return common(
        Policy.History.KeepAll if qos.reliable else newest,
        Policy.Durability.TransientLocal,
        Policy.DurabilityService(0, Policy.History.KeepLast(qos.depth), unlimited, unlimited, unlimited),
        *more,
    )


def _policies(qos: QoS) -> Iterator[Any]:
    """Those that mean the same in DDS."""
    if qos.history is History.KEEP_ALL:
        yield Policy.ResourceLimits(KEEP_ALL_DEPTH, -1, KEEP_ALL_DEPTH)
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


class Link:
    """One end of a channel. `facing` is the role of the other."""

    role: str
    facing: str

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        self.transport, self.channel = transport, channel
        self.bus = transport.bus
        self.stats = Statistics()
        self.closed = threading.Event()
        self.id = transport.new_id()
        self._closing = threading.Lock()
        self._looking = threading.RLock()
        self._news = threading.Event()
        """Set when somebody came or went, and when the link is closed."""
        self._next_look = _LOOK
        self._reported: set[object] = set()
        self._sparing = Sparing()

    def open(self) -> None:
        """Make what is needed."""

    def look(self) -> None:
        """Somebody came or went."""
        with self._looking:
            if not self.closed.is_set():
                self.looked(self.counterparts())
        self._next_look = _LOOK
        self._news.set()

    def looked(self, there: list[Endpoint]) -> None:
        """`there` are those who face us and mean the same."""

    def tick(self) -> float:
        """Do what is due; the time of the next."""
        return float("inf")

    def wait_peer(self, timeout: float) -> bool:
        end = time.monotonic() + timeout
        while True:
            self.check_open()
            self._news.clear()
            if self.visible():
                return True
            if time.monotonic() >= end:
                return False
            self.await_news(end)

    def await_news(self, end: float) -> None:
        """Wait until somebody comes or goes; a while only, for whom it knows but has not matched is not told."""
        self._news.wait(min(self._next_look, max(0.0, end - time.monotonic())))
        self._next_look = min(1.5 * self._next_look, _LONGEST_LOOK)

    def visible(self) -> bool:
        """Whether the other side is there. Raises ContractMismatch if only others are."""
        return bool(self.counterparts(strict=True))

    def close(self) -> None:
        with self._closing:
            if self.closed.is_set():
                return
            self.closed.set()
        self._news.set()
        self.transport.left(self)
        with self._looking:  # so that nothing is made any more
            pass
        if not self.bus.lost:
            self.release()

    def release(self) -> None:
        """Let go of what this link holds; called once, when it is closed."""

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

    def counterparts(self, *, strict: bool = False) -> list[Endpoint]:
        """Those we face who mean the same by the name; the others are reported, once each.

        With `strict`, raises ContractMismatch if there are only others.
        """
        named = [
            endpoint
            for endpoint in self.bus.endpoints.find(self.facing, self.channel.name)
            if endpoint.channel == self.channel.name or not self.transport.owns(endpoint.id)
        ]
        mine = self.channel.type.fingerprint
        same = [endpoint for endpoint in named if endpoint.fingerprint == mine]
        for endpoint in named:
            if endpoint.fingerprint != mine:
                self.report_mismatch((endpoint.id, endpoint.fingerprint), type_of(endpoint))
        if strict and named and not same:
            raise ContractMismatch(mismatch(self.channel, type_of(named[0])))
        return same

    def check_open(self) -> None:
        if self.closed.is_set() or self.transport.closed:
            raise Closed(f"{self.channel.name}: {self.transport.gone}")

    def report_mismatch(self, who: object, other: TypeRef) -> None:
        if who not in self._reported and len(self._reported) < STRANGERS:
            self._reported.add(who)
            if self._sparing.may_tell():
                log.error("%s", mismatch(self.channel, other))
            self.stats.mismatched += 1  # at last: who sees the count finds the reason in the log

    def malformed(self, why: object) -> None:
        """Count a message that is none of ours; the first one is logged."""
        self.stats.malformed += 1
        if self.stats.malformed == 1:
            log.warning("%s: dropped a malformed message (further ones are only counted): %s", self.channel.name, why)


def type_of(endpoint: Endpoint) -> TypeRef:
    return TypeRef("", endpoint.fingerprint, endpoint.text)


def enter(link: Link, order: threading.Lock, deadline: float) -> None:
    """Take the lock of those who send by a link, who may hold it until deadlines of their own."""
    if order.acquire(blocking=False):
        return
    step_aside()  # what they wait for may come in by this very thread
    if not order.acquire(timeout=max(0.0, deadline)):
        raise Timeout(f"{link.channel.name}: another thread was still sending after {deadline:g} s")
