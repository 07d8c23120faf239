"""What a subscriber does about the QoS of those it hears, on every transport in the same way.

    meet      who is there, and what each offers: what is missing is said once; lifespans hold from now on
    admit     a message came in: it is noted for deadlines and liveliness, and given up if it is too old
    delivery  a message may have become too old while it waited

The age of a message is counted from the stamp in its header, by the clocks of both hosts; on two
hosts, lifespans are worth as much as these agree. What waits here is timed by the monotonic clock.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from ..contract.interface import Pattern
from ..contract.qos import QoS, Shortfall, duration, shortfalls
from ..wire.codec import Payload
from .base import Channel, Sink, Source, Statistics

log = logging.getLogger("robocomp.transport")

TOO_OLD: Any = object()
"""What `admit` returns in place of a payload that is not to be delivered."""

_MOST_TOLD = 1000
"""Of so many publishers it is said what they do not offer; further ones are not looked at."""


class _Ageing(NamedTuple):
    """A payload that is delivered until then, by the monotonic clock."""

    until: float
    payload: Any


class Reception:
    """One subscription. `through` puts something in front of its sink; it is called at most once.

    While nobody asks for anything, `on` is False, and `admit` need not be called.
    """

    def __init__(self, channel: Channel, stats: Statistics, through: Callable[[Callable[[Sink], Sink]], object]) -> None:
        self._channel, self._stats, self._through = channel, stats, through
        self._heard = channel.heard
        self._lifespans: dict[str, float] = {}
        """By channel: the shorter one of ours and its publisher's."""
        self._told: set[tuple[str, QoS]] = set()
        self._ageing = False
        self.on = self._heard is not None
        if channel.qos.lifespan is not None and channel.pattern is Pattern.PUBLISH:
            self._start_ageing()

    def meet(self, sources: Iterable[Source]) -> None:
        """These publish now. To be called when that changes; not for every message."""
        for name, offered in sources:
            if offered.lifespan is not None and self._lifespans.get(name) != offered.lifespan:
                self._lifespans[name] = min(offered.lifespan, self._channel.qos.lifespan or offered.lifespan)
                self._start_ageing()
            if (name, offered) not in self._told and len(self._told) < _MOST_TOLD:
                self._told.add((name, offered))
                missing = shortfalls(self._channel.qos, offered)
                if missing:
                    log.warning("%s", _unkept(self._channel.name, name, missing))

    def admit(self, name: str, stamp: int, payload: Payload) -> Payload:
        """A new message of that channel, sent at `stamp` (ns since the Unix epoch): what is to be delivered, or TOO_OLD."""
        if self._heard:
            self._heard(name)
        if not self._ageing:
            return payload
        lifespan = self._lifespans.get(name, self._channel.qos.lifespan)
        if lifespan is None:
            return payload
        left = lifespan - max(0, time.time_ns() - stamp) / 1e9
        if left <= 0:
            self._expired(name, f"a message came in {duration(lifespan - left)} old, and its lifespan is {duration(lifespan)}")
            return TOO_OLD
        return _Ageing(time.monotonic() + left, payload)

    def _start_ageing(self) -> None:
        if not self._ageing:
            self._through(self._while_fresh)
            self._ageing = self.on = True  # at last: what is admitted as ageing is known to be so when it is delivered

    def _while_fresh(self, sink: Sink) -> Sink:
        def deliver(payload: Payload) -> None:
            if type(payload) is not _Ageing:  # it came in before anybody spoke of lifespans
                sink(payload)
            elif time.monotonic() < payload.until:
                sink(payload.payload)
            else:
                self._stats.received -= 1  # it was counted on its way here
                self._expired(self._channel.name, "a message waited for its handler longer than its lifespan allows")

        return deliver

    def _expired(self, name: str, why: str) -> None:
        if self._stats.expired == 0:
            log.warning("%s: dropped: %s (further ones are only counted)", name, why)
        self._stats.expired += 1


def _unkept(channel: str, publisher: str, missing: list[Shortfall]) -> str:
    """For the log: what is missing, of whom, and what to do about it."""
    whose = f" of {publisher}" if publisher != channel else ""
    return (
        f"{channel}: the publisher{whose} keeps less than this subscription asks for: {'; '.join(map(str, missing))}. "
        f"Give its port the qos that ours has, or ours {', '.join(each.less for each in missing)}"
    )
