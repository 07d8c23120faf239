"""Counts missed deadlines and lost publishers of a topic. Pure: the caller passes messages and the time.

    heard    a message came in (or went out, if a publisher watches itself), by name of its channel
    look     returns the deadlines missed and the publishers lost since the last call

    deadline     after the first message, every `deadline` seconds without another one are a miss. A
                 publisher that is gone misses once; its deadline runs again with its next message.
    liveliness   a publisher is lost when it is gone or, if `manual_by_topic`, when it has sent nothing
                 for `lease` seconds. It may come back, and be lost again.

Each miss and each loss is reported once, however late `look` is called.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from ..contract.qos import Liveliness, QoS

LOOKS = 4
"""Number of times per lease that the publishers are checked."""

QUICKEST, SLOWEST = 0.005, 1.0
"""Shortest and longest time between two checks, in seconds."""

CHANNELS = 1024
"""Maximum number of watched channels of one subscription; further ones are ignored."""

Sources = Callable[[], Mapping[str, QoS]]
"""Returns the live publishers: the QoS that each offers, by the name of its channel."""


@dataclass(frozen=True, slots=True)
class Missed:
    """Missed deadlines of a channel: `more` since the last report, `total` since the start."""

    channel: str
    more: int
    total: int


@dataclass(frozen=True, slots=True)
class Lost:
    """The publisher of a channel was lost: `more` times since the last report, `total` since the start."""

    channel: str
    more: int
    total: int


@dataclass(slots=True)
class _Watched:
    """The state of one channel."""

    heard: float | None = None
    """Time of the last message."""
    running: bool = False
    """Whether a deadline runs since the last message."""
    counted: int = 0
    """Deadlines missed since the last message."""
    untold: int = 0
    """Missed deadlines that were not reported yet."""
    alive: bool = False
    seen: bool = False
    """Whether its publisher was present at the last check."""
    lease: float = math.inf
    manual: bool = False
    """Whether each message proves that the publisher is alive (`manual_by_topic`)."""
    losses: int = 0
    """Losses that were not reported yet."""
    missed: int = 0
    lost: int = 0


class Watch:
    """Watches one subscription, or one publisher. All times are of one monotonic clock. Not locked."""

    def __init__(self, qos: QoS) -> None:
        self._deadline, self._lease = qos.deadline, qos.lease
        self._manual = qos.liveliness is Liveliness.MANUAL_BY_TOPIC
        self._channels: dict[str, _Watched] = {}
        self._next = -math.inf

    @property
    def missed(self) -> int:
        return sum(each.missed for each in self._channels.values())

    @property
    def lost(self) -> int:
        return sum(each.lost for each in self._channels.values())

    def heard(self, channel: str, now: float) -> bool:
        """Note a message. Returns True if `due` may have become earlier."""
        each = self._known(channel)
        if each is None:
            return False
        begins = not each.running and self._deadline is not None
        if self._lease is not None and each.heard is None:  # check at once, before a new publisher can be gone again
            self._next, begins = -math.inf, True
        self._count_misses(each, now)
        self._count_silence(each, now)
        each.heard, each.running, each.counted = now, self._deadline is not None, 0
        each.alive |= each.manual
        return begins or each.untold + each.losses > 0

    def alive(self) -> list[str]:
        """The channels whose publishers were alive at the last check."""
        return [name for name, each in self._channels.items() if each.alive and each.seen]

    def due(self) -> float:
        """The time at which `look` should be called next."""
        due = self._next if self._lease is not None else math.inf
        for each in self._channels.values():
            if each.untold or each.losses:
                return -math.inf
            if each.heard is not None and each.running and self._deadline is not None:
                due = min(due, each.heard + (each.counted + 1) * self._deadline)
            if each.heard is not None and each.alive and each.manual:
                due = min(due, each.heard + each.lease)
        return due

    def look(self, now: float, sources: Sources) -> list[Missed | Lost]:
        """The deadlines missed and publishers lost since the last call. Calls `sources` only if needed."""
        if now < self.due():
            return []
        there = sources()
        for name, each in self._channels.items():
            self._count_misses(each, now, there=name in there)
        if self._lease is not None:
            self._look_who_lives(self._lease, now, there)
        return list(self._news())

    def _news(self) -> Iterator[Missed | Lost]:
        for name, each in self._channels.items():
            if each.untold:
                yield Missed(name, each.untold, each.missed)
            if each.losses:
                yield Lost(name, each.losses, each.lost)
            each.untold = each.losses = 0

    def _count_misses(self, each: _Watched, now: float, *, there: bool = True) -> None:
        """Count missed deadlines; of a publisher that is gone only one, until it is back."""
        if self._deadline is None or each.heard is None or not each.running:
            return
        more = math.ceil((now - each.heard) / self._deadline - _TOLERANCE) - 1 - each.counted
        if more <= 0:
            return
        if not there:
            each.running = False
            more = 0 if each.counted else 1
        each.counted += more
        each.untold += more
        each.missed += more

    def _look_who_lives(self, asked: float, now: float, there: Mapping[str, QoS]) -> None:
        for name, offered in there.items():
            each = self._known(name)
            if each is not None:
                each.lease = min(asked, offered.lease or asked)
                each.manual = self._manual or offered.liveliness is Liveliness.MANUAL_BY_TOPIC
                each.alive |= not each.manual
                each.seen = True
        shortest = asked
        for name, each in self._channels.items():
            self._count_silence(each, now)
            if each.alive and each.seen and name not in there:
                self._lose(each)
            each.seen = name in there
            shortest = min(shortest, each.lease)
        self._next = now + min(max(shortest / LOOKS, QUICKEST), SLOWEST)

    def _count_silence(self, each: _Watched, now: float) -> None:
        if each.alive and each.manual and each.heard is not None and now - each.heard > each.lease * (1 - _TOLERANCE):
            self._lose(each)

    def _lose(self, each: _Watched) -> None:
        each.alive = False
        each.losses += 1
        each.lost += 1

    def _known(self, channel: str) -> _Watched | None:
        if channel not in self._channels and len(self._channels) < CHANNELS:
            self._channels[channel] = _Watched(lease=self._lease or math.inf, manual=self._manual and bool(self._lease))
        return self._channels.get(channel)


_TOLERANCE = 1e-9
"""Rounding error of times, as a fraction of a deadline or lease."""
