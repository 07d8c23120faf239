"""What the arrivals of a topic's messages tell: rate, gaps, sizes and ages. Pure."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

_SILENT = 1.0
"""A topic whose last message is older than this, in seconds, may count as silent."""

_LONGEST_INTERVALS = 3.0
"""It does if that is also longer than this number of its longest intervals."""

_MOST_SOURCES = 1000
"""Publishers whose numbers are remembered."""


class Arrival(NamedTuple):
    """A message has come in."""

    channel: str
    at: float
    """`time.monotonic()`."""
    octets: int
    source: int = 0
    """The link of its publisher; 0 if the message does not tell, as those of other programs."""
    sequence: int = 0
    """Counts the messages of a source."""
    age: float = math.nan
    """Seconds since it was sent, by the clocks of both sides; NaN if the message does not tell."""
    host: str = ""
    """The host whose scout has heard it; "" if this process has."""


class Rate(NamedTuple):
    hz: float
    shortest: float
    """Interval between two messages in seconds."""
    longest: float


class Sizes(NamedTuple):
    """In octets."""

    per_second: float
    smallest: int
    mean: float
    largest: int


class Ages(NamedTuple):
    """In seconds."""

    median: float
    p99: float
    """99 % of the messages are not older."""


class Traffic:
    """The latest messages of one topic; `number`, `missing` and `gaps` are those of all."""

    def __init__(self, window: int) -> None:
        self._latest: deque[Arrival] = deque(maxlen=window + 1)  # one more, for the interval before the oldest
        self._since: float | None = None
        """When the measurement began again, if nothing has arrived since then."""
        self._sequences: dict[int, int] = {}
        self.number = 0
        self.missing = 0
        """Messages that were sent and did not arrive here, as far as their numbers tell."""
        self.gaps = 0
        """How often messages were missing."""
        self.is_numbered = True
        """Whether all messages had numbers, so that missing ones were noticed."""

    def note(self, arrival: Arrival) -> None:
        self.number += 1
        self._latest.append(arrival)
        self._since = None
        if not arrival.source:
            self.is_numbered = False
            return
        missing = arrival.sequence - self._sequences.get(arrival.source, arrival.sequence - 1) - 1
        if missing > 0:
            self.missing += missing
            self.gaps += 1
        if missing >= 0:
            if len(self._sequences) >= _MOST_SOURCES:
                self._sequences.clear()
            self._sequences[arrival.source] = arrival.sequence

    def resume(self, at: float) -> None:
        """Nothing was received until now, which is neither an interval nor a gap."""
        self._latest.clear()
        self._sequences.clear()
        self._since = at

    def silence(self, now: float) -> float:
        """Seconds without a message, if they are more than those between its messages let expect; else 0."""
        if not self._latest:
            return now - self._since if self._since is not None and now - self._since > _SILENT else 0.0
        silent = now - self._latest[-1].at
        longest = max(self._intervals(), default=0.0)
        return silent if silent > max(_SILENT, _LONGEST_INTERVALS * longest) else 0.0

    def rate(self) -> Rate | None:
        """None before the second message."""
        intervals = self._intervals()
        if not sum(intervals):
            return None
        return Rate(len(intervals) / math.fsum(intervals), min(intervals), max(intervals))

    def sizes(self) -> Sizes | None:
        """None before the second message."""
        rate = self.rate()
        if rate is None:
            return None
        octets = [each.octets for each in self._counted()]
        mean = sum(octets) / len(octets)
        return Sizes(mean * rate.hz, min(octets), mean, max(octets))

    def ages(self) -> Ages | None:
        """None if no message tells when it was sent."""
        ages = sorted(each.age for each in self._counted() if not math.isnan(each.age))
        if not ages:
            return None
        middle = (ages[(len(ages) - 1) // 2] + ages[len(ages) // 2]) / 2
        return Ages(middle, ages[math.ceil(0.99 * len(ages)) - 1])

    def _intervals(self) -> list[float]:
        return [later.at - earlier.at for earlier, later in pairwise(self._latest)]

    def _counted(self) -> Sequence[Arrival]:
        """The messages of the window."""
        found = list(self._latest)
        return found[1:] if len(found) == self._latest.maxlen else found
