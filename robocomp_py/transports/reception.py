"""How a subscriber applies QoS, the same on every transport.

    meet      publishers and their QoS are known: logs once what a publisher lacks; lifespans apply from now on
    admit     a message arrived: notes it for deadlines and liveliness, and notes when it becomes too old
    delivery  before the sink: drops a message that has become too old

On arrival, the age of a message is computed from the stamp in its header. Between two hosts it is only as exact as
their clocks agree. After arrival the monotonic clock counts.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from ..contract.interface import Pattern
from ..contract.qos import QoS, Shortfall, duration, from_traits, shortfalls
from ..wire.codec import Payload
from .base import Channel, Heard, Sink, Source, Statistics
from .directory import Directory
from .members import Found
from .senders import From, publisher, signing

log = logging.getLogger("robocomp.transport")

HISTORY_TRIES = 3
"""Attempts to get the latched messages of a publisher; then the subscriber goes on with new messages."""

_MOST = 1000
"""Maximum number of publishers whose QoS is checked; further ones are taken to offer enough."""


def living(directory: Directory, found: Iterable[Found], asked: QoS) -> list[Source]:
    """The publishers of a directory whose processes live.

    A stopped process (SIGSTOP) counts for half of its lease, so that its loss is noticed within the whole lease.
    """
    sources = [(member, Source(entry.channel, from_traits(entry.traits))) for member, entry in found]
    leases = (min(filter(None, (asked.lease, source.qos.lease)), default=math.inf) for _, source in sources)
    return [
        source for (member, source), lease in zip(sources, leases, strict=True) if directory.responds(member, lease / 2)
    ]


class _Ageing(NamedTuple):
    """A payload that may be delivered `until` then, by the monotonic clock; `age` is its age on arrival."""

    until: float
    age: float
    lifespan: float
    payload: Any


class Reception:
    """One subscription. `through` wraps its sink; it is called at most once.

    While no QoS needs it, `on` is False, and `admit` need not be called.
    """

    def __init__(
        self,
        channel: Channel,
        stats: Statistics,
        through: Callable[[Callable[[Sink], Sink]], object],
        now: Callable[[], float] = time.monotonic,
        stamp_now: Callable[[], int] = time.time_ns,
    ) -> None:
        self._channel, self._stats, self._through = channel, stats, through
        self._now, self._stamp_now = now, stamp_now
        self._on_receive = channel.on_receive
        self._lifespans: dict[str, float] = {}
        """By channel: the shorter lifespan of subscriber and publisher."""
        self._told: set[tuple[str, QoS]] = set()
        self._meeting = threading.Lock()
        """Held by `meet`: the receiving thread and one that waits for a connection may look at the same time."""
        self._ageing = False
        self._headed = channel.headed and channel.pattern is Pattern.PUBLISH
        self.on = self._headed or self._on_receive is not None
        self._signed = channel.signed and channel.pattern is Pattern.PUBLISH
        if self._signed or (channel.qos.lifespan is not None and channel.pattern is Pattern.PUBLISH):
            self._start_ageing()

    def meet(self, sources: Iterable[Source]) -> None:
        """These are the publishers now. To be called when they change, not for every message."""
        with self._meeting:
            for name, offered in sources:
                if offered.lifespan is None:
                    self._lifespans.pop(name, None)
                elif len(self._lifespans) < _MOST:
                    self._lifespans[name] = min(offered.lifespan, self._channel.qos.lifespan or offered.lifespan)
                    self._start_ageing()
                if (name, offered) not in self._told and len(self._told) < _MOST:
                    self._told.add((name, offered))
                    missing = shortfalls(self._channel.qos, offered)
                    if missing:
                        log.warning("%s", _unkept(self._channel.name, name, missing))

    def admit(self, name: str, stamp: int, payload: Payload, source: int = 0, sequence: int = 0) -> Payload:
        """A new message of a channel, sent at `stamp` (ns since the Unix epoch; 0 if that is not known).

        `source` and `sequence` are those of its header; 0 if it has none.

        Returns what is to be passed to the sink.
        """
        if self._on_receive:
            self._on_receive(name)
        if self._headed:
            payload = Heard(name, source, sequence, stamp, payload)
        if not self._ageing:
            return payload
        if self._signed:
            payload = From(publisher(name), payload)
        lifespan = self._lifespans.get(name, self._channel.qos.lifespan)
        if lifespan is None:
            return payload
        age = max(0, self._stamp_now() - stamp) / 1e9 if stamp > 0 else 0.0
        return _Ageing(self._now() + lifespan - age, age, lifespan, payload)

    def _start_ageing(self) -> None:
        if not self._ageing:
            self._through(self._while_fresh)
            self._ageing = self.on = True  # after wrapping the sink, which must unwrap every `_Ageing`

    def _while_fresh(self, sink: Sink) -> Sink:
        if self._signed:
            sink = signing(sink)

        def deliver(payload: Payload) -> None:
            if type(payload) is not _Ageing:  # it arrived before a lifespan applied
                sink(payload)
            elif self._now() < payload.until:
                sink(payload.payload)
            else:
                self._stats.received -= 1  # the queue has counted it already
                self._expired(payload)

        return deliver

    def _expired(self, message: _Ageing) -> None:
        if self._stats.expired == 0:
            when = (
                f"when it came in, {duration(message.age)} after it was sent"
                if message.age > message.lifespan
                else "when its turn came"
            )
            log.warning(
                "%s: dropped a message that was older than its lifespan of %s %s (further ones are only counted)",
                self._channel.name,
                duration(message.lifespan),
                when,
            )
        self._stats.expired += 1


def _unkept(channel: str, publisher: str, missing: list[Shortfall]) -> str:
    """For the log: what is missing, which publisher lacks it, and the remedy."""
    whose = f" of {publisher}" if publisher != channel else ""
    return (
        f"{channel}: the publisher{whose} keeps less than this subscription asks for: {'; '.join(map(str, missing))}. "
        f"Give its port the qos that ours has, or ours {', '.join(each.less for each in missing)}"
    )
