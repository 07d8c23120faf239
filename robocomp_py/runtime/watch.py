"""Whether messages come as often as they should, and whether those who send them live. Pure.

    heard    a message came in (or, of a publisher's own watch, went out), by name of its channel
    look     time has passed: what was missed and lost until now

    deadline     from the first message on, for every `deadline` seconds without one, one miss; a
                 publisher that is not there any more misses once, and then counts when it is back
    liveliness   lost: who was there and is not, or (`manual_by_topic`) has sent nothing for `lease`
                 seconds since the last message; it may come back, and be lost again

Nothing is missed or lost twice, however late somebody looks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from ..contract.qos import Liveliness, QoS

LOOKS = 4
"""In each lease it is looked so often who is there."""

QUICKEST, SLOWEST = 0.005, 1.0
"""Seconds between two looks at who is there, at least and at most."""

CHANNELS = 1024
"""So many channels of one subscription are watched; further ones are not."""

Sources = Callable[[], Mapping[str, QoS]]
"""Who publishes now and lives, by name of the channel, and what each offers."""


@dataclass(frozen=True, slots=True)
class Missed:
    """`more` deadlines were missed on a channel since that was last told, `total` since it is watched."""

    channel: str
    more: int
    total: int


@dataclass(frozen=True, slots=True)
class Lost:
    """Who publishes on a channel was lost, `more` times since that was last told; `total` as above."""

    channel: str
    more: int
    total: int


@dataclass(slots=True)
class _Watched:
    """A channel."""

    heard: float | None = None
    """When the last message came."""
    running: bool = False
    """Whether a deadline runs since then."""
    counted: int = 0
    """How many have been missed since then."""
    untold: int = 0
    alive: bool = False
    seen: bool = False
    """Whether its publisher was there at the last look."""
    lease: float = math.inf
    manual: bool = False
    """Whether it lives by what it sends."""
    losses: int = 0
    """Those that nobody has been told of; as `untold` of deadlines."""
    missed: int = 0
    lost: int = 0


class Watch:
    """Of one subscription, or of one publisher; times are those of one monotonic clock. Not locked."""

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
        """A message came; whether `due` may be earlier now."""
        each = self._known(channel)
        if each is None:
            return False
        begins = not each.running and self._deadline is not None
        if self._lease is not None and each.heard is None:  # who has just come is to be seen, however soon it goes
            self._next, begins = -math.inf, True
        self._count_misses(each, now)
        self._count_silence(each, now)
        each.heard, each.running, each.counted = now, self._deadline is not None, 0
        each.alive |= each.manual
        return begins or each.untold + each.losses > 0

    def alive(self) -> list[str]:
        """The channels whose publishers lived at the last look."""
        return [name for name, each in self._channels.items() if each.alive and each.seen]

    def due(self) -> float:
        """When to look."""
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
        """What was missed or lost since the last look. Calls `sources` only if it matters."""
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
        """Count what was missed; of one who is not there any more a single miss, and then nothing."""
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
"""Of a deadline or lease: what calculating with times may be wrong by."""
