"""Measures a small query and publication with both processes on one core, and on two cores.

Otherwise the kernel places each pair of processes, and may move them: the comparison would then depend more on their
places than on their work.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from .pair import Pair
from .publish import latency_of
from .query import Tell, both, round_trips, some
from .rounds import Effort, Rounds, Times, by_turns, difference, joined, ratio, times
from .tables import Table, times_as_much, us

SIZE = 64

PLACES = {"one core": (0, 0), "a core each": (0, 1)}
"""Which of our cores the near end has, and which the far one."""


@dataclass(frozen=True)
class Row:
    middleware: str
    what: str
    where: str
    ours: Times
    raw: Times
    ratio: float
    more: float
    """µs that ours takes longer."""


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < 2:
        return []
    rows = []
    for middleware in middlewares:
        if middleware == "inproc":
            continue  # whose two ends are one process
        found: dict[tuple[str, str], list[Rounds]] = {}
        for some_rounds in effort.starts:
            with both(middleware, 10) as pairs:
                try:
                    for where, (near, far) in PLACES.items():
                        for pair in pairs:
                            _tie(pair.far_pid, {cores[far]})
                        _tie(os.getpid(), {cores[near]})
                        for what, measure in (("query", round_trips), ("publish", _latencies)):
                            tell(f"placement · {middleware} · {what} · {where}")
                            found.setdefault((what, where), []).append(measure(middleware, SIZE, pairs, some_rounds))
                finally:
                    _tie(os.getpid(), set(cores))
        for (what, where), starts in found.items():
            ours, raw = joined(starts)
            rows.append(Row(middleware, what, where, times(ours), times(raw), ratio(ours, raw), difference(ours, raw)))
    return rows


def _latencies(middleware: str, size: int, pairs: list[Pair], effort: Effort) -> Rounds:
    data = some(size)
    return by_turns([latency_of(pair, pair.near.publish, data, effort.seconds) for pair in pairs], effort.rounds)


def _tie(pid: int, cores: set[int]) -> None:
    """Tie all threads of a process, except those that have ended meanwhile."""
    for thread in Path(f"/proc/{pid}/task").iterdir():
        try:
            os.sched_setaffinity(int(thread.name), cores)
        except ProcessLookupError:
            continue


def table(rows: list[Row]) -> Table:
    head = ("", "", "", "ours p50", "p99", "raw p50", "p99", "ratio", "difference")
    cells = [
        (
            *(row.middleware, row.what, row.where, us(row.ours.p50), us(row.ours.p99)),
            *(us(row.raw.p50), us(row.raw.p99), times_as_much(row.ratio), f"{row.more:+.1f} µs"),
        )
        for row in rows
    ]
    note = "" if rows else "it takes two cores, and two processes"
    return Table("placement", "64 bytes, and where the processes are", head, cells, labels=3, note=note)
