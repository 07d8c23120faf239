"""Measures what the counters of operations cost: a query through proxy and handler with them, and without.

Both are measured in turn, in one run. Without means the same code but for the counters and the watching of calls;
it is written out here, so a change of `BoundQuery.ask` or `BoundHandler.serve` has to be made here, too.
"""

from __future__ import annotations

import statistics
import tracemalloc
from collections.abc import Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from typing import Any

from robocomp_py.runtime import ports
from robocomp_py.runtime.load import load_worker
from robocomp_py.runtime.tally import MOST_KEPT, Tallies, Tally
from robocomp_py.transports.base import Reply
from robocomp_py.wire.codec import Payload

from . import ours as counted
from .compared import ours
from .components import COMPONENTS
from .goals import Finding, failed
from .pair import Pair, place
from .parties import FAILURES, Hear, Party, Place
from .query import Tell, round_trips
from .rounds import Effort, Rounds, difference, joined, ratio, seconds_of, times
from .tables import Table, us

SIZE = 64

MORE, TIMES = 0.2, 1.02
"""Goals: µs more within one process, and times as much between two."""

MEASURED = ("inproc", "shm", "zeromq")


class Uncounted:
    """A query without counters."""

    def __init__(self, query: ports.BoundQuery) -> None:
        self._call, self._caller, self._monitor, self._deadline = (
            query._call,
            query._caller,
            query._monitor,
            query._deadline,
        )

    def ask(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        limit = self._deadline if deadline is None else ports._positive(deadline)
        payload = self._call.encode(arguments)
        suspended = self._monitor.suspend()
        try:
            reply = self._caller.ask(payload, limit)
        finally:
            if suspended:
                self._monitor.resume(suspended)
        return self._call.value(reply.payload) if reply.status is ports._OK else self._call.result(reply)


class UncountedHandler(ports.BoundHandler):
    """A handler without counters, as long as the component is free."""

    def serve(self, payload: Payload, expires: float) -> Reply | Future[Reply]:
        arguments = self._answering.decode(payload)
        if self._outside:
            return self._answering.answer(arguments)
        if not self._concurrent and self._monitor.try_enter():
            try:
                return self._answering.answer(arguments)
            finally:
                self._monitor.leave()
        return super().serve(payload, expires)


class Far(counted.Far):
    def __init__(self, middleware: str, place: Place, hear: Hear) -> None:
        before = ports.BoundHandler
        ports.BoundHandler = UncountedHandler  # type: ignore[misc]  # for as long as handlers are bound
        try:
            super().__init__(middleware, place, hear, within="uncounted")
        finally:
            ports.BoundHandler = before  # type: ignore[misc]  # the original class


class Near(counted.Near):
    def __init__(self, middleware: str, place: Place) -> None:
        super().__init__(middleware, place, within="uncounted")
        ports.wrap(self._asking, Uncounted)


@dataclass(frozen=True)
class Row:
    """In µs: medians, and the median of the rounds' differences."""

    middleware: str
    counted: float = 0.0
    uncounted: float = 0.0
    more: float = 0.0
    ratio: float = 0.0
    failure: str = ""

    @property
    def met(self) -> bool:
        return self.more <= MORE if self.middleware == "inproc" else self.ratio <= TIMES


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    return [_row(each, effort, tell) for each in middlewares if each in MEASURED]


def _row(middleware: str, effort: Effort, tell: Tell) -> Row:
    found: list[Rounds] = []
    try:
        for some_rounds in effort.starts:
            tell(f"counters · {middleware}")
            with (
                place() as here,
                Pair(ours(middleware), here) as with_them,
                Pair(_without(middleware), here) as without,
            ):
                found.append(round_trips(middleware, SIZE, [with_them, without], some_rounds))
    except FAILURES as exc:
        return Row(middleware, failure=f"{exc}" or type(exc).__name__)
    with_counters, without_them = joined(found)
    p50s = times(with_counters).p50, times(without_them).p50
    return Row(middleware, *p50s, difference(with_counters, without_them), ratio(with_counters, without_them))


def _without(middleware: str) -> Party:
    return Party(partial(Far, middleware), partial(Near, middleware), apart=middleware != "inproc")


def table(rows: list[Row]) -> Table:
    head = ("", "with counters", "without", "difference", "ratio", "goal")
    note = "; ".join(f"{row.middleware} failed: {row.failure}" for row in rows if row.failure)
    return Table("counters", f"query of {SIZE} B, with counters and without", head, list(map(_cells, rows)), 1, note)


def _cells(row: Row) -> tuple[str, ...]:
    if row.failure:
        return (row.middleware, *["–"] * 4, "")
    demand = f"+{MORE:g} µs" if row.middleware == "inproc" else f"{TIMES:.2f} ×"
    verdict = f"≤ {demand}: {'met' if row.met else 'missed'}"
    return row.middleware, us(row.counted), us(row.uncounted), f"{row.more:+.2f} µs", f"{row.ratio:.3f} ×", verdict


def findings(rows: list[Row]) -> list[Finding]:
    return [
        failed("counters", row.middleware)
        if row.failure
        else Finding("counters", row.middleware, "", f"{row.more:+.2f} µs, {row.ratio:.3f} ×", row.met, row.ratio)
        for row in rows
    ]


# What counters cost a component besides.

COMPONENT = "world2d"


@dataclass(frozen=True)
class Kept:
    """The counters of a shipped component."""

    operations: int
    seconds: float
    """To make all of them, at its start."""
    octets: int
    """Of all, with all durations that they keep."""


def kept(effort: Effort) -> Kept:
    ports_of = load_worker(COMPONENTS / COMPONENT).component.ports
    ends = [(port, *each) for port in ports_of for each in port.interface.under(port.verb)]

    def counted() -> Tallies:
        tallies = Tallies()
        for port, operation, pattern in ends:
            tallies.add(Tally(port, operation, pattern, _ROUTE), _LINK)
        return tallies

    seconds = statistics.median(seconds_of(counted, 10 * effort.rounds))
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        tallies = counted()
        for each in tallies.every:
            for number in range(2 * MOST_KEPT):
                each.time(float(number), 1e-4, 1e-5)
        octets = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    return Kept(len(ends), seconds, octets)


_ROUTE: Any = None
_LINK: Any = None
"""A counter only keeps them."""
