"""What a subscriber does about the QoS of those it hears, on every transport in the same way.

    meet      who is there, and what each offers: what is missing is said once; lifespans hold from now on
    admit     a message came in: it is noted for deadlines and liveliness, and how long it may wait
    delivery  when its turn has come, it is given up if it has become too old

The age of a message is counted from the stamp in its header, by the clocks of both hosts; on two
hosts, lifespans are worth as much as these agree. From then on the monotonic clock counts.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from ..contract.interface import Pattern
from ..contract.qos import QoS, Shortfall, duration, from_traits, shortfalls
from ..wire.codec import Payload
from .base import Channel, Sink, Source, Statistics
from .directory import Directory, Found

log = logging.getLogger("robocomp.transport")

HISTORY_TRIES = 3
"""So often what a publisher has latched is asked for if it does not come in time; then what comes next is heard."""

_MOST = 1000
"""What so many publishers offer is looked at; further ones pass for such that offer what is asked for."""


def living(directory: Directory, found: Iterable[Found], asked: QoS) -> list[Source]:
    """Those of a directory that publish, and whose processes live.

    One that is stopped is given half of its lease, so that it is missed within the whole of it.
    """
    sources = [(member, Source(entry.channel, from_traits(entry.traits))) for member, entry in found]
    leases = (min(filter(None, (asked.lease, source.qos.lease)), default=math.inf) for _, source in sources)
    return [
        source for (member, source), lease in zip(sources, leases, strict=True) if directory.responds(member, lease / 2)
    ]


class _Ageing(NamedTuple):
    """A payload that is delivered until then, by the monotonic clock; it had some age when it came in."""

    until: float
    age: float
    lifespan: float
    payload: Any


class Reception:
    """One subscription. `through` puts something in front of its sink; it is called at most once.

    While nobody asks for anything, `on` is False, and `admit` need not be called.
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
        """By channel: the shorter one of ours and its publisher's."""
        self._told: set[tuple[str, QoS]] = set()
        self._ageing = False
        self.on = self._on_receive is not None
        if channel.qos.lifespan is not None and channel.pattern is Pattern.PUBLISH:
            self._start_ageing()

    def meet(self, sources: Iterable[Source]) -> None:
        """These publish now. To be called when that changes; not for every message."""
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

    def admit(self, name: str, stamp: int, payload: Payload) -> Payload:
        """A new message of a channel, sent at `stamp` (ns since the Unix epoch; 0 if that is not known).

        Returns what is to be passed to the sink.
        """
        if self._on_receive:
            self._on_receive(name)
        if not self._ageing:
            return payload
        lifespan = self._lifespans.get(name, self._channel.qos.lifespan)
        if lifespan is None:
            return payload
        age = max(0, self._stamp_now() - stamp) / 1e9 if stamp > 0 else 0.0
        return _Ageing(self._now() + lifespan - age, age, lifespan, payload)

    def _start_ageing(self) -> None:
        if not self._ageing:
            self._through(self._while_fresh)
            self._ageing = self.on = True  # at last: what is admitted as ageing is known to be so when it is delivered

    def _while_fresh(self, sink: Sink) -> Sink:
        def deliver(payload: Payload) -> None:
            if type(payload) is not _Ageing:  # it came in before anybody spoke of lifespans
                sink(payload)
            elif self._now() < payload.until:
                sink(payload.payload)
            else:
                self._stats.received -= 1  # it was counted on its way here
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
    """For the log: what is missing, of whom, and what to do about it."""
    whose = f" of {publisher}" if publisher != channel else ""
    return (
        f"{channel}: the publisher{whose} keeps less than this subscription asks for: {'; '.join(map(str, missing))}. "
        f"Give its port the qos that ours has, or ours {', '.join(each.less for each in missing)}"
    )
