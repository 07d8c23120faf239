"""A question and its answer, between two processes: through a generated-style proxy, and the bare library.

The array that was asked comes back. One question at a time; the next follows at once.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from . import parties
from .pair import Pair, place
from .parties import Array, Near
from .rounds import Effort, Times, by_turns, how_many, ratio, seconds_of, times
from .tables import Table, octets, times_as_much, us

Tell = Callable[[str], None]
"""Says how far it is."""


@dataclass(frozen=True)
class Row:
    middleware: str
    size: int
    ours: Times
    raw: Times | None = None
    ratio: float | None = None

    @property
    def allowed(self) -> float | None:
        """The p50 in µs that we want to stay below, if there is a goal for this size."""
        if self.raw is None or self.size not in (64, 1_000_000):
            return None
        return max(1.35 * self.raw.p50, self.raw.p50 + 25) if self.size == 64 else 1.25 * self.raw.p50


def run(middlewares: Iterable[str], sizes: Iterable[int], effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    for middleware in middlewares:
        with both(middleware, 10) as pairs:
            for size in sizes:
                tell(f"query · {middleware} · {octets(size)}")
                rows.append(_row(middleware, size, [pair.near for pair in pairs], effort))
    return rows


@contextlib.contextmanager
def both(middleware: str, depth: int) -> Iterator[list[Pair]]:
    """Our pair, and that of the bare library if there is one."""
    with place(depth) as here, contextlib.ExitStack() as open_pairs:
        bare = parties.raw(middleware)
        compared = [parties.ours(middleware), *([bare] if bare else [])]
        yield [open_pairs.enter_context(Pair(party, here)) for party in compared]


def some(size: int) -> Array:
    """An array whose memory is really there, as it would not be if it were all zeros."""
    return np.random.default_rng(size).integers(0, 256, size, np.uint8)


def _row(middleware: str, size: int, nears: list[Near], effort: Effort) -> Row:
    data = some(size)
    measures = []
    for near in nears:
        if not np.array_equal(near.ask(data), data):
            raise ValueError(f"{middleware}: the answer is not what was asked")
        ask = partial(near.ask, data)
        measures.append(partial(seconds_of, ask, how_many(ask, effort.seconds)))
    ours, *raw = by_turns(measures, effort.rounds)
    if not raw:
        return Row(middleware, size, times(ours))
    return Row(middleware, size, times(ours), times(raw[0]), ratio(ours, raw[0]))


def table(rows: list[Row]) -> Table:
    head = ("", "array", "ours p50", "p99", "raw p50", "p99", "ratio", "difference", "goal")
    return Table("query", "query round trip", head, [_cells(row) for row in rows])


def _cells(row: Row) -> tuple[str, ...]:
    name = (row.middleware, octets(row.size), us(row.ours.p50), us(row.ours.p99))
    if row.raw is None:
        return (*name, "–", "–", "–", "–", "")
    difference = row.ours.p50 - row.raw.p50
    signed = f"{'-' if difference < 0 else '+'}{us(abs(difference))}"
    return (*name, us(row.raw.p50), us(row.raw.p99), times_as_much(row.ratio), signed, _verdict(row))


def _verdict(row: Row) -> str:
    if row.allowed is None:
        return ""
    return f"≤ {us(row.allowed)}: {'met' if row.ours.p50 <= row.allowed else 'missed'}"
