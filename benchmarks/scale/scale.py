"""All measurements of a growing network, their tables and their goals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from .. import query
from ..goals import Finding
from ..pair import place
from ..parties import FAILURES
from ..query import Tell
from ..rounds import QUICK, Effort
from ..tables import Table, octets, times_as_much, us
from . import arrivals, clients, fanout, idle, mixed
from .arrivals import Arrivals
from .clients import Clients
from .ends import OURS, RAW
from .fanout import Fanout
from .idle import Idle
from .mixed import Mixed

MIDDLEWARES = ("shm", "zeromq", "zenoh", "dds")
SIZES = (64, 1024, 16 * 1024, 65_536, 262_144, 1_000_000, 4_000_000, 16_000_000, 64_000_000)

MEGABYTES, DESCRIPTORS, READY = 60.0, 64, 1.0
"""Goals for the most idle publications: megabytes, descriptors, and seconds until they are there."""
TIMES, FAIR = 1.6, 0.9
"""Goals for many clients: p99 ÷ bare, and Jain's index."""
MIXED = 2.0
"""Goal for a quick call while one client calls a slow operation: p99 ÷ p99 without that."""
FANOUT = 1.3
"""Goal for subscribers: processor time ÷ bare, and p99 ÷ bare."""

Row = Any
"""`Idle`, `Clients`, `Mixed`, `Fanout`, `Arrivals`, or a row of `query` with `part` "sizes"."""


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> tuple[list[Row], list[str]]:
    """The rows, and what failed. With less than a quick effort, only the smallest numbers and sizes."""
    few = 2 if effort.rounds < QUICK.rounds else None
    chosen = [each for each in MIDDLEWARES if each in middlewares]
    parts: list[tuple[str, Callable[[str, Any], Iterator[Row]]]] = [
        ("idle", lambda name, at: idle.measure(name, at, idle.NUMBERS[:few])),
        ("clients", lambda name, at: clients.measure(name, at, clients.NUMBERS[:few], 10 * effort.seconds)),
        (
            "mixed",
            lambda name, at: mixed.measure(name, at, mixed.NUMBERS, min(5, effort.rounds), 3 * effort.seconds),
        ),
        (
            "fanout",
            lambda name, at: fanout.measure(name, at, fanout.NUMBERS[:few], fanout.SIZES, 15 * effort.seconds),
        ),
        ("arrivals", lambda name, at: arrivals.measure(name, at, arrivals.NUMBERS[:few], 30 * effort.seconds)),
    ]
    rows, failures = list[Row](), list[str]()
    for part, measure in parts:
        for middleware in chosen:
            try:
                for row in _each(middleware, measure):
                    tell(f"scale · {part} · {middleware} · {row.number} {row.party}")
                    rows.append(row)
            except FAILURES as exc:
                failures.append(f"{part}: {middleware}: {exc}")
    found = query.run(chosen, SIZES[:few], Effort(min(3, effort.rounds), effort.seconds), tell)
    failures += [f"sizes: {row.middleware}: {octets(row.size)}: {row.failure}" for row in found if row.failure]
    return [*rows, *(row for row in found if not row.failure)], failures


def _each(middleware: str, measure: Callable[[str, Any], Iterator[Row]]) -> Iterator[Row]:
    with place() as here:
        yield from measure(middleware, here)


# Tables.


def tables(rows: Sequence[Row]) -> list[Table]:
    return [
        _beside(
            "scale-idle",
            "publications that no peer asks for",
            ("publications", "memory", "descriptors", "ready after"),
            _of(rows, Idle),
            lambda row: (f"{row.megabytes:.1f} MB", f"{row.descriptors}", f"{row.seconds:.2f} s"),
        ),
        _beside(
            "scale-clients",
            "one server, 64 B there and back, clients that ask again at once",
            ("clients", "calls a second", "p99", "Jain's index"),
            _of(rows, Clients),
            lambda row: (f"{row.rate:,.0f}", us(row.p99), f"{row.fairness:.3f}"),
        ),
        _beside(
            "scale-mixed",
            "a server with an operation that takes 5 ms, a client that calls a quick one",
            ("clients of the slow one", "p99 without them", "p99", "ratio"),
            _of(rows, Mixed),
            lambda row: (us(row.alone), us(row.beside), times_as_much(row.factor)),
        ),
        _beside(
            "scale-fanout",
            "one publisher at 50 Hz, for each subscriber",
            ("subscribers", "core, subscriber", "core, publisher", "p99"),
            _of(rows, Fanout),
            lambda row: (f"{row.cpu:.2f} %", f"{row.publishing:.2f} %", us(row.p99)),
            lambda row: f"{row.number} × {octets(row.size)}",
        ),
        _sizes(_of(rows, query.Row)),
        _arrivals(_of(rows, Arrivals)),
    ]


def _of(rows: Iterable[Row], kind: type) -> list[Row]:
    return [row for row in rows if isinstance(row, kind)]


def _beside(
    name: str,
    title: str,
    head: tuple[str, ...],
    rows: Sequence[Row],
    cells: Callable[[Row], tuple[str, ...]],
    label: Callable[[Row], str] = lambda row: f"{row.number}",
) -> Table:
    """Ours and bare in one row."""
    lines: dict[tuple[str, str], dict[str, tuple[str, ...]]] = {}
    for row in rows:
        lines.setdefault((row.middleware, label(row)), {})[row.party] = cells(row)
    nothing = ("–",) * (len(head) - 1)
    body = [
        (*key, *(cell for pair in zip(found.get(OURS, nothing), found.get(RAW, nothing), strict=True) for cell in pair))
        for key, found in lines.items()
    ]
    wide = tuple(cell for each in head[1:] for cell in (each, "bare"))
    return Table(name, title, ("", head[0], *wide), body)


def _sizes(rows: Sequence[query.Row]) -> Table:
    cells = [
        (
            row.middleware,
            octets(row.size),
            us(row.ours.p50),
            us(row.raw.p50),
            times_as_much(row.ratio),
            us(row.ours.p99),
        )
        for row in rows
        if row.ours and row.raw
    ]
    return Table("scale-sizes", "there and back, by size", ("", "array", "p50", "bare", "ratio", "p99"), cells)


def _arrivals(rows: Sequence[Arrivals]) -> Table:
    cells = [
        (
            row.middleware,
            f"{row.number}, {'connected' if row.waits else 'at once'}",
            *(f"{each:,}" for each in (row.sent, row.heard, row.undiscovered, row.lost, row.missing)),
        )
        for row in rows
    ]
    head = ("", "topics", "sent", "heard", "not discovered", "counted as lost", "not accounted for")
    return Table("scale-arrivals", "topics at 10 Hz", head, cells)


# Goals.


def findings(rows: Sequence[Row]) -> list[Finding]:
    return [
        *_of_idle(_of(rows, Idle)),
        *_of_clients(_of(rows, Clients)),
        *_of_mixed(_of(rows, Mixed)),
        *_of_fanout(_of(rows, Fanout)),
    ] + [
        Finding(
            "arrivals",
            row.middleware,
            f"{row.number} topics",
            f"{row.missing:,} of {row.sent:,}",
            row.missing == 0,
            value=row.missing / row.sent,
        )
        for row in _of(rows, Arrivals)
        if row.waits
    ]


def _of_idle(rows: Sequence[Idle]) -> Iterator[Finding]:
    for row in rows:
        if row.party == OURS and row.number == idle.NUMBERS[-1]:
            met = row.megabytes <= MEGABYTES and row.descriptors <= DESCRIPTORS and row.seconds <= READY
            shown = f"{row.megabytes:.0f} MB, {row.descriptors}, {row.seconds:.2f} s"
            yield Finding("publications", row.middleware, "", shown, met, value=row.descriptors)


def _of_clients(rows: Sequence[Clients]) -> Iterator[Finding]:
    found = {(row.middleware, row.party, row.number): row for row in rows}
    most = clients.NUMBERS[-1]
    for (middleware, party, number), row in found.items():
        two = found.get((middleware, OURS, 2))
        if party == OURS and number == most and two:
            raw = found.get((middleware, RAW, most))
            late = row.p99 / raw.p99 if raw else 0.0
            met = row.rate >= two.rate and row.fairness >= FAIR and late <= TIMES
            shown = f"{row.rate / two.rate:.2f} ×, {times_as_much(late) if raw else 'no bare'}, {row.fairness:.2f}"
            yield Finding("clients", middleware, "", shown, met, value=two.rate / row.rate)


def _of_mixed(rows: Sequence[Mixed]) -> Iterator[Finding]:
    for row in rows:
        if row.party == OURS and row.number == mixed.NUMBERS[0]:
            shown = f"{row.factor:.2f} ×, {us(row.beside)}"
            yield Finding("mixed", row.middleware, "", shown, row.factor <= MIXED, value=row.factor)


def _of_fanout(rows: Sequence[Fanout]) -> Iterator[Finding]:
    found = {(row.middleware, row.size, row.number, row.party): row for row in rows}
    for (middleware, size, number, party), row in found.items():
        raw = found.get((middleware, size, number, RAW))
        if party == OURS and raw and raw.cpu and raw.p99:
            cpu, late = row.cpu / raw.cpu, row.p99 / raw.p99
            case = f"{number} × {octets(size)}"
            met = max(cpu, late) <= FANOUT
            yield Finding("fanout", middleware, case, f"{cpu:.2f} ×, {late:.2f} ×", met, value=max(cpu, late))
