"""Measures a query between two processes: through a proxy like a generated one, and by the bare library.

The reply is the array of the request. There is one query at a time; the next follows at once.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from robocomp_py.transports.base import TransportConfig, hosting

from . import compared
from .goals import Finding, failed
from .ours import options
from .pair import Pair, place
from .parties import BROKERED, FAILURES, Array
from .rounds import Effort, Rounds, Times, by_turns, difference, how_many, joined, ratio, seconds_of, times
from .tables import Table, octets, times_as_much, us

M = TypeVar("M")

Tell = Callable[[str], None]
"""Says how far it is."""


MORE, SMALL, LARGE = 12.0, 1.15, 1.10
"""Goals: up to 1 KB, µs more than the bare library, or times as much; of 1 MB and more, times as much."""

INPROC = 10.0
"""Goal within one process, where there is no bare library, in µs."""


@dataclass(frozen=True)
class Row:
    middleware: str
    size: int
    ours: Times | None = None
    raw: Times | None = None
    ratio: float | None = None
    more: float | None = None
    """How many µs more ours takes: like the ratio, the median of the rounds' differences."""
    failure: str = ""
    """Why there are no figures."""

    @property
    def goal(self) -> str:
        """The goal for this size, if there is one."""
        if self.middleware == "inproc":
            return "inproc" if self.size <= 1024 else ""
        return "small" if self.size <= 1024 else "large" if self.size >= 1_000_000 else ""

    @property
    def met(self) -> bool:
        if self.ours is None:
            return False
        if self.ratio is None or self.more is None:
            return self.ours.p50 <= INPROC
        if self.goal == "small":
            return round(self.ratio, 2) <= SMALL or self.more <= MORE
        return round(self.ratio, 2) <= LARGE


def run(middlewares: Iterable[str], sizes: Sequence[int], effort: Effort, tell: Tell) -> list[Row]:
    return [row for middleware in middlewares for row in _rows(middleware, sizes, effort, tell)]


def _rows(middleware: str, sizes: Sequence[int], effort: Effort, tell: Tell) -> list[Row]:
    def measure(size: int, pairs: list[Pair], some_rounds: Effort) -> Rounds:
        tell(f"query · {middleware} · {octets(size)}")
        return round_trips(middleware, size, pairs, some_rounds)

    return [
        Row(middleware, size, failure=failure) if failure else _row(middleware, size, joined(starts))
        for size, starts, failure in by_starts(middleware, 10, sizes, effort, measure)
    ]


def by_starts(
    middleware: str, depth: int, sizes: Sequence[int], effort: Effort, measure: Callable[[int, list[Pair], Effort], M]
) -> list[tuple[int, list[M], str]]:
    """Of each size what was measured in each start of the pairs; or why there is nothing. What fails at one size does
    not keep the figures of smaller ones from anybody."""
    found: dict[int, list[M]] = {size: [] for size in sizes}
    failed: dict[int, str] = {}
    for some_rounds in effort.starts:
        left = [size for size in sizes if size not in failed]
        if not left:
            break
        try:
            with both(middleware, depth) as pairs:
                while left:
                    found[left[0]].append(measure(left[0], pairs, some_rounds))
                    del left[0]
        except FAILURES as exc:
            failed |= dict.fromkeys(left, f"{exc}" or type(exc).__name__)
    return [(size, found[size], failed.get(size, "")) for size in sizes]


@contextlib.contextmanager
def both(middleware: str, depth: int) -> Iterator[list[Pair]]:
    """Our pair, and that of the bare library if there is one."""
    with place(depth) as here, contextlib.ExitStack() as open_pairs:
        if middleware in BROKERED:
            open_pairs.enter_context(hosting(middleware, TransportConfig(options(middleware, here))))
        bare = compared.raw(middleware)
        parties = [compared.ours(middleware), *([bare] if bare else [])]
        pairs = [Pair(party, here) for party in parties]
        for pair in pairs:
            open_pairs.callback(pair.close)
        yield [pair.__enter__() for pair in pairs]


def some(size: int) -> Array:
    """An array whose memory is really allocated, unlike that of an array of zeros."""
    return np.random.default_rng(size).integers(0, 256, size, np.uint8)


def round_trips(middleware: str, size: int, pairs: Iterable[Pair], effort: Effort) -> Rounds:
    """The round trips of each pair, in seconds."""
    data = some(size)
    measures = []
    for pair in pairs:
        if not np.array_equal(pair.near.ask(data), data):
            raise ValueError(f"{middleware}: the answer is not what was asked")
        ask = partial(pair.near.ask, data)
        measures.append(partial(seconds_of, ask, how_many(ask, effort.seconds)))
    return by_turns(measures, effort.rounds)


def _row(middleware: str, size: int, rounds: Rounds) -> Row:
    ours, *raw = rounds
    if not raw:
        return Row(middleware, size, times(ours))
    return Row(middleware, size, times(ours), times(raw[0]), ratio(ours, raw[0]), difference(ours, raw[0]))


def table(rows: list[Row]) -> Table:
    head = ("", "array", "ours p50", "p99", "raw p50", "p99", "ratio", "difference", "goal")
    note = "; ".join(dict.fromkeys(f"{row.middleware} failed: {row.failure}" for row in rows if row.failure))
    return Table("query", "query round trip", head, [_cells(row) for row in rows], note=note)


def _cells(row: Row) -> tuple[str, ...]:
    name = (row.middleware, octets(row.size), *((us(row.ours.p50), us(row.ours.p99)) if row.ours else ("–", "–")))
    if row.raw is None or row.more is None:
        return (*name, "–", "–", "–", "–", _verdict(row))
    signed = f"{'-' if row.more < 0 else '+'}{us(abs(row.more))}"
    return (*name, us(row.raw.p50), us(row.raw.p99), times_as_much(row.ratio), signed, _verdict(row))


def _verdict(row: Row) -> str:
    demands = {
        "small": f"≤ {SMALL:.2f} × or +{MORE:g} µs",
        "large": f"≤ {LARGE:.2f} ×",
        "inproc": f"≤ {INPROC:g} µs",
    }
    return f"{demands[row.goal]}: {'met' if row.met else 'missed'}" if row.goal and row.ours else ""


def findings(rows: list[Row]) -> list[Finding]:
    return [_finding(row) for row in rows if row.goal]


def _finding(row: Row) -> Finding:
    if row.ours is None:
        return failed(row.goal, row.middleware, octets(row.size))
    shown = us(row.ours.p50) if row.ratio is None else times_as_much(row.ratio)
    return Finding(
        row.goal,
        row.middleware,
        octets(row.size),
        shown,
        row.met,
        row.ratio,
        row.ours.p50 if row.ratio is None else row.ratio,
    )
