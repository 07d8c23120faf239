"""Measures what a diary costs a component: one event, encoded and written.

The time is that of the processor, because a disk that is busy with something else says nothing about us.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robocomp_py.contract.interface import Operation, Pattern
from robocomp_py.tools.diary.coding import request_of
from robocomp_py.tools.diary.events import DiaryWriter

from .ours import BYTES
from .query import Tell
from .rounds import Effort
from .tables import Table, octets, us

GOALS = {64: 1.9, 6_000_000: 25_000.0}
"""µs of an event, by the size of its data."""

EACH = 64_000_000
"""Octets that a round writes, at most; the smallest event counts as 10 kB."""

_seen: Operation[None] = Operation("Benchmark::Camera", "seen", BYTES, pattern=Pattern.PUBLISH)


@dataclass(frozen=True)
class Row:
    size: int
    taken: float
    """In µs; the median of the rounds."""

    @property
    def met(self) -> bool:
        return self.taken <= GOALS[self.size]


def run(effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    for size in GOALS:
        tell(f"diary · {octets(size)}")
        rows.append(Row(size, statistics.median(_round(size) for _ in range(effort.rounds))))
    return rows


def _round(size: int) -> float:
    request, values = request_of(_seen), (np.zeros(size, np.uint8),)
    count = EACH // max(size, 10_000)
    with tempfile.TemporaryDirectory(prefix="rc-") as folder:
        diary = DiaryWriter(Path(folder) / "diary.mcap")
        begun = time.thread_time()
        for _ in range(count):
            diary.write("out", 1, "camera.seen", request(values))
        taken = time.thread_time() - begun
        diary.close()
    return taken / count * 1e6


def table(rows: list[Row]) -> Table:
    cells = [
        (octets(row.size), us(row.taken), f"≤ {us(GOALS[row.size])}: {'met' if row.met else 'missed'}") for row in rows
    ]
    return Table("diary", "an event of a diary", ("data", "processor", "goal"), cells)
