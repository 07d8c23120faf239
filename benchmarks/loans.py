"""Measures messages that are filled in the memory that is sent.

The time begins when the message is filled, and ends when the handler reads its array. A large message should take
hardly longer than a small one. The next one follows a millisecond later, as in `publish`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from . import compared
from .goals import Finding
from .pair import Pair, place
from .parties import Lender
from .publish import latency_of
from .query import Tell, some
from .rounds import Effort, Times, by_turns, ratio, times
from .tables import Table, octets, times_as_much, us

GOAL = 2.0
"""Times as long, on shared memory."""

SMALL, LARGE = 64, 6_000_000


@dataclass(frozen=True)
class Row:
    middleware: str
    small: Times
    large: Times
    copied: Times
    """The large one when it is published without a loan, its array in the publisher's own memory."""
    ratio: float
    """Large ÷ small."""


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    for middleware in middlewares:
        tell(f"loans · {middleware}")
        with place() as here, Pair(compared.ours(middleware), here) as pair:
            near = pair.near
            assert isinstance(near, Lender)
            measures = [
                latency_of(pair, publish, some(size), effort.seconds)
                for publish, size in ((near.lend, SMALL), (near.lend, LARGE), (near.publish, LARGE))
            ]
            small, large, copied = by_turns(measures, effort.rounds)
        rows.append(Row(middleware, times(small), times(large), times(copied), ratio(large, small)))
    return rows


def table(rows: list[Row]) -> Table:
    head = ("", f"loan, {octets(SMALL)}", "p99", f"loan, {octets(LARGE)}", "p99", "ratio", "goal", "without a loan")
    cells = [
        (
            row.middleware,
            *(us(figure) for each in (row.small, row.large) for figure in (each.p50, each.p99)),
            times_as_much(row.ratio),
            f"≤ {GOAL:g} ×: {'met' if row.ratio <= GOAL else 'missed'}" if row.middleware == "shm" else "",
            us(row.copied.p50),
        )
        for row in rows
    ]
    return Table("loans", "publish: latency of a message that is filled in place", head, cells, labels=1)


def findings(rows: list[Row]) -> list[Finding]:
    return [
        Finding("loan", row.middleware, "", times_as_much(row.ratio), row.ratio <= GOAL, row.ratio)
        for row in rows
        if row.middleware == "shm"
    ]
