"""Measures a reliable topic from one process to another: latency and throughput.

Latency is one way: a message carries the time at which it was passed to `publish`, and the subscriber first reads the
clock, which is the same for all processes of a host. The next message follows a millisecond later, so no message
queues, and all threads sleep again.

Throughput: messages are published one after the other, at full speed. It is the number of received messages, from
sending the first to receiving the last. None should be lost.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

from .goals import Finding, failed
from .pair import MOST, Pair
from .parties import PATIENCE, Array, stamp
from .query import Tell, by_starts, some
from .rounds import Effort, Rounds, Times, by_turns, how_many, joined, ratio, times
from .tables import Table, octets, times_as_much, us

GOAL = 1.15
"""Times the latency of the bare library; and times as many messages through the bare library."""

PAUSE = 0.001
"""Seconds from the arrival of a message to the next, when latency is measured."""

QUIET = 2.0
"""Seconds without a message after which the missing ones count as lost."""

LARGE, FEW, MANY = 1_000_000, 10, 1000
"""From so many bytes on, few messages may wait for the subscriber (the default of our QoS); else many."""

_LOOK = 50e-6


@dataclass(frozen=True)
class Figures:
    """The figures of one party."""

    latency: Times
    rate: float
    """Messages per second."""
    lost: int


@dataclass(frozen=True)
class Row:
    middleware: str
    size: int
    ours: Figures | None = None
    raw: Figures | None = None
    latency_ratio: float | None = None
    rate_ratio: float | None = None
    """How many times as many messages come through the bare library."""
    failure: str = ""
    """Why there are no figures."""


@dataclass
class _Flood:
    """Publishes at full speed. `lost` counts messages that did not arrive."""

    pair: Pair
    data: Array
    count: int = 20
    lost: int = 0

    def rate(self) -> list[float]:
        record, near, data = self.pair.record, self.pair.near, self.data
        record.clear()
        begun = time.monotonic_ns()
        for _ in range(self.count):
            stamp(data)
            near.publish(data)
        _settle(lambda: record.count, self.count)
        heard = record.times()
        self.lost += self.count - len(heard)
        if not heard:
            raise TimeoutError("nothing arrived")
        return [len(heard) / (heard[-1][1] - begun) * 1e9]

    def choose(self, seconds: float) -> None:
        """Choose a number of messages that takes about this long."""
        for _ in range(2):  # 20 say little about small ones
            self.count = max(20, min(MOST, int(self.rate()[0] * seconds)))


def run(middlewares: Iterable[str], sizes: Sequence[int], effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    few = [size for size in sizes if size >= LARGE]
    many = [size for size in sizes if size < LARGE]
    for middleware, (depth, group) in itertools.product(middlewares, ((MANY, many), (FEW, few))):
        if group:
            rows += _rows(middleware, depth, group, effort, tell)
    return rows


def _rows(middleware: str, depth: int, sizes: list[int], effort: Effort, tell: Tell) -> list[Row]:
    def measure(size: int, pairs: list[Pair], some_rounds: Effort) -> _Measured:
        tell(f"publish · {middleware} · {octets(size)}")
        return _measure(size, pairs, some_rounds)

    return [
        Row(middleware, size, failure=failure) if failure else _row(middleware, size, starts)
        for size, starts, failure in by_starts(middleware, depth, sizes, effort, measure)
    ]


@dataclass(frozen=True)
class _Measured:
    """The measurements of each party, from one start to its end."""

    latencies: Rounds
    rates: Rounds
    lost: list[int]


def _measure(size: int, pairs: list[Pair], effort: Effort) -> _Measured:
    data = some(size)
    measures = [latency_of(pair, pair.near.publish, data, effort.seconds) for pair in pairs]
    latencies = by_turns(measures, effort.rounds)
    floods = [_Flood(pair, data) for pair in pairs]
    for flood in floods:
        flood.choose(effort.seconds)
    return _Measured(
        latencies, by_turns([flood.rate for flood in floods], effort.rounds), [each.lost for each in floods]
    )


def _row(middleware: str, size: int, starts: list[_Measured]) -> Row:
    latencies, rates = joined([each.latencies for each in starts]), joined([each.rates for each in starts])
    lost = [sum(counts) for counts in zip(*(each.lost for each in starts), strict=True)]
    ours, *raw = (
        Figures(times(latency), statistics.median(each[0] for each in rate), count)
        for latency, rate, count in zip(latencies, rates, lost, strict=True)
    )
    if not raw:
        return Row(middleware, size, ours)
    return Row(middleware, size, ours, raw[0], ratio(*latencies), ratio(*reversed(rates)))


def latency_of(pair: Pair, publish: Callable[[Array], None], data: Array, seconds: float) -> Callable[[], list[float]]:
    """A function that measures, for about this long, the seconds from sending to the handler."""
    count = how_many(partial(_latencies, pair, publish, data, 1), seconds)
    return partial(_latencies, pair, publish, data, count)


def _latencies(pair: Pair, publish: Callable[[Array], None], data: Array, count: int) -> list[float]:
    record = pair.record
    record.clear()
    for number in range(1, count + 1):
        stamp(data)
        publish(data)
        end = time.monotonic() + PATIENCE
        while record.count < number:
            if time.monotonic() > end:
                raise TimeoutError("a message did not arrive")
            time.sleep(_LOOK)
        time.sleep(PAUSE)
    return [(heard - sent) / 1e9 for sent, heard in record.times()]


def _settle(count: Callable[[], int], wanted: int) -> None:
    """Wait until all have arrived, or none arrives for a while."""
    seen, since = -1, time.monotonic()
    while (now := count()) < wanted and time.monotonic() - since < QUIET:
        if now != seen:
            seen, since = now, time.monotonic()
        time.sleep(0.001)


def tables(rows: list[Row]) -> list[Table]:
    latency = ("", "array", "ours p50", "p99", "raw p50", "p99", "ratio", "goal")
    rate = ("", "array", "ours", "", "raw", "", "raw ÷ ours", "lost, ours", "raw", "goal")
    note = "; ".join(dict.fromkeys(f"{row.middleware} failed: {row.failure}" for row in rows if row.failure))
    return [
        Table("latency", "publish: latency, one way", latency, [_latency_cells(row) for row in rows], note=note),
        Table("throughput", "publish: throughput, what arrived", rate, [_rate_cells(row) for row in rows], note=note),
    ]


def _latency_cells(row: Row) -> tuple[str, ...]:
    found = [(us(each.latency.p50), us(each.latency.p99)) if each else ("–", "–") for each in (row.ours, row.raw)]
    return (
        row.middleware,
        octets(row.size),
        *found[0],
        *found[1],
        times_as_much(row.latency_ratio),
        _verdict(row.latency_ratio),
    )


def _rate_cells(row: Row) -> tuple[str, ...]:
    ours, its = (_rate(each, row.size) for each in (row.ours, row.raw))
    lost = (str(each.lost) if each else "–" for each in (row.ours, row.raw))
    return (
        row.middleware,
        octets(row.size),
        *ours,
        *its,
        times_as_much(row.rate_ratio),
        *lost,
        _verdict(row.rate_ratio),
    )


def _rate(figures: Figures | None, size: int) -> tuple[str, str]:
    if figures is None:
        return "–", "–"
    megabytes = figures.rate * size / 1e6
    return f"{figures.rate:.0f}/s", f"{megabytes:.{0 if megabytes >= 10 else 1}f} MB/s"


def _verdict(found: float | None) -> str:
    return "" if found is None else f"≤ {GOAL:g} ×: {'met' if round(found, 2) <= GOAL else 'missed'}"


def findings(rows: list[Row]) -> list[Finding]:
    made = []
    for goal, row in itertools.product(("latency", "rate"), rows):
        found = row.latency_ratio if goal == "latency" else row.rate_ratio
        if row.failure:
            made.append(failed(goal, row.middleware, octets(row.size)))
        elif found is not None:
            made.append(
                Finding(goal, row.middleware, octets(row.size), times_as_much(found), round(found, 2) <= GOAL, found)
            )
    return made
