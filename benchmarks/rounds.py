"""Compares parties on a machine that is never quiet: in short rounds, in turn.

A disturbance affects neighbouring rounds in the same way. So the ratio of two parties is the median of the ratios
within the rounds; look at it first.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

MOST_CALLS = 5000
"""Per round."""


@dataclass(frozen=True)
class Effort:
    """The extent of a measurement: rounds per cell of a table, and seconds per round and party."""

    rounds: int
    seconds: float

    @property
    def halved(self) -> Effort:
        """Half the effort, for measurements that explain others."""
        return Effort((self.rounds + 1) // 2, self.seconds)

    @property
    def starts(self) -> list[Effort]:
        """The same, four rounds at a time, for processes that are started anew each time: where their memory happens
        to lie makes a tenth, for as long as they live."""
        fours, rest = divmod(self.rounds, 4)
        return [Effort(4, self.seconds)] * fours + [Effort(rest, self.seconds)] * (rest > 0)

    @property
    def watched(self) -> float:
        """Seconds for which nearly idle processes are watched."""
        return 100 * self.seconds


FULL, QUICK = Effort(16, 0.1), Effort(3, 0.05)


@dataclass(frozen=True)
class Times:
    """In µs: the median of the rounds' medians, the 99th percentile of all values, and further percentiles."""

    p50: float
    p99: float
    percentiles: tuple[tuple[float, float], ...] = ()
    """Pairs of a percentage, one of `PERCENTAGES`, and the time."""


PERCENTAGES = (5, 25, 75, 90, 95, 99.9)


Rounds = list[list[list[float]]]
"""What was measured: of each party, in each round."""


def joined(starts: Sequence[Rounds]) -> Rounds:
    """The rounds of parties that were started several times, joined."""
    return [[each for rounds in of_party for each in rounds] for of_party in zip(*starts, strict=True)]


def by_turns(parties: Sequence[Callable[[], list[float]]], rounds: int) -> Rounds:
    """The measurements of each party in each round. The last party of a round is the first of the next."""
    found: Rounds = [[] for _ in parties]
    for number in range(rounds):
        turns = list(enumerate(parties))
        for index, measure in turns if number % 2 == 0 else reversed(turns):
            found[index].append(measure())
    return found


def seconds_of(call: Callable[[], object], count: int) -> list[float]:
    """The duration of each of these calls."""
    taken, now = [], time.perf_counter
    for _ in range(count):
        begun = now()
        call()
        taken.append(now() - begun)
    return taken


def how_many(call: Callable[[], object], seconds: float) -> int:
    """The number of calls that takes this long, found by calling, which also warms up."""
    end = time.perf_counter() + seconds / 2
    taken = seconds_of(call, 3)
    while time.perf_counter() < end:
        taken += seconds_of(call, 1)
    return max(5, min(MOST_CALLS, int(seconds / statistics.median(taken))))


def times(rounds: list[list[float]]) -> Times:
    """The times, from measurements in seconds."""
    everything = sorted(value for each in rounds for value in each)

    def percentile(percentage: float) -> float:
        return everything[int(len(everything) * percentage / 100)] * 1e6

    median = statistics.median(map(statistics.median, rounds)) * 1e6
    return Times(median, percentile(99), tuple((each, percentile(each)) for each in PERCENTAGES))


def ratio(ours: list[list[float]], raw: list[list[float]]) -> float:
    """The ratio of ours to raw."""
    pairs = zip(ours, raw, strict=True)
    return statistics.median(statistics.median(mine) / statistics.median(its) for mine, its in pairs)


def difference(ours: list[list[float]], raw: list[list[float]]) -> float:
    """The µs that ours took longer, from measurements in seconds."""
    pairs = zip(ours, raw, strict=True)
    return statistics.median(statistics.median(mine) - statistics.median(its) for mine, its in pairs) * 1e6
