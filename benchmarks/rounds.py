"""How two are compared on a machine that is never quiet: in short rounds, by turns.

What disturbs one round disturbs its neighbour much the same. So the ratio of two parties is the
median over the rounds of the ratio within each round, and that is what to look at first.
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
    """How much is measured: rounds per cell of a table, and seconds per round and party."""

    rounds: int
    seconds: float

    @property
    def halved(self) -> Effort:
        """For what explains rather than judges."""
        return Effort((self.rounds + 1) // 2, self.seconds)

    @property
    def starts(self) -> list[Effort]:
        """The same, four rounds at a time, for processes that are started anew each time: where their memory happens
        to lie makes a tenth, for as long as they live."""
        fours, rest = divmod(self.rounds, 4)
        return [Effort(4, self.seconds)] * fours + [Effort(rest, self.seconds)] * (rest > 0)

    @property
    def watched(self) -> float:
        """Seconds for which processes are watched that do little."""
        return 100 * self.seconds


FULL, QUICK = Effort(16, 0.1), Effort(3, 0.05)


@dataclass(frozen=True)
class Times:
    """In µs: the median over rounds of their medians, the 99th percentile of all values, and others of all values."""

    p50: float
    p99: float
    percentiles: tuple[tuple[float, float], ...] = ()
    """Pairs of a percentage, one of `PERCENTAGES`, and the time."""


PERCENTAGES = (5, 25, 75, 90, 95, 99.9)


Rounds = list[list[list[float]]]
"""What was measured: of each party, in each round."""


def joined(starts: Sequence[Rounds]) -> Rounds:
    """The rounds of the same parties, started several times, as if it had been once."""
    return [[each for rounds in of_party for each in rounds] for of_party in zip(*starts, strict=True)]


def by_turns(parties: Sequence[Callable[[], list[float]]], rounds: int) -> Rounds:
    """What each party measured in each round. Whoever was last in a round is first in the next."""
    found: Rounds = [[] for _ in parties]
    for number in range(rounds):
        turns = list(enumerate(parties))
        for index, measure in turns if number % 2 == 0 else reversed(turns):
            found[index].append(measure())
    return found


def seconds_of(call: Callable[[], object], count: int) -> list[float]:
    """How long each of so many calls took."""
    taken, now = [], time.perf_counter
    for _ in range(count):
        begun = now()
        call()
        taken.append(now() - begun)
    return taken


def how_many(call: Callable[[], object], seconds: float) -> int:
    """Calls that fill so many seconds, found by calling, which also warms up."""
    end = time.perf_counter() + seconds / 2
    taken = seconds_of(call, 3)
    while time.perf_counter() < end:
        taken += seconds_of(call, 1)
    return max(5, min(MOST_CALLS, int(seconds / statistics.median(taken))))


def times(rounds: list[list[float]]) -> Times:
    """Of what was measured in seconds."""
    everything = sorted(value for each in rounds for value in each)

    def percentile(percentage: float) -> float:
        return everything[int(len(everything) * percentage / 100)] * 1e6

    median = statistics.median(map(statistics.median, rounds)) * 1e6
    return Times(median, percentile(99), tuple((each, percentile(each)) for each in PERCENTAGES))


def ratio(ours: list[list[float]], raw: list[list[float]]) -> float:
    """How many times as much ours took, or did."""
    pairs = zip(ours, raw, strict=True)
    return statistics.median(statistics.median(mine) / statistics.median(its) for mine, its in pairs)


def difference(ours: list[list[float]], raw: list[list[float]]) -> float:
    """How many µs more ours took, of what was measured in seconds."""
    pairs = zip(ours, raw, strict=True)
    return statistics.median(statistics.median(mine) - statistics.median(its) for mine, its in pairs) * 1e6
