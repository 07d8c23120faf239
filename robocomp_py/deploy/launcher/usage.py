"""The processor time and memory of processes, measured at limited intervals, however often they are requested."""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from . import cgroups, traces

_PAUSE = 2.0
"""Minimum number of seconds between two measurements."""

_LONGEST = 30.0
"""The maximum."""

_SHARE = 0.01
"""Share of time that measuring may take: with hundreds of processes, or on a busy machine, it is done less often."""

_MEASURED = 20
"""Maximum number of processes whose memory is measured at a time, which is slow; the others keep their last figure."""

_TICK = os.sysconf("SC_CLK_TCK")
_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True)
class Used:
    pid: int
    cpu_s: float
    memory: int
    at: float
    """The time of the measurement."""


class Meter:
    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._next = 0.0
        self._used: dict[str, Used] = {}
        self._measured: dict[tuple[str, int], int] = {}
        """Bytes by name and id, since a name may mean another process by now; the last measured comes last."""

    def read(self, running: Mapping[str, tuple[int, Path | None]]) -> Mapping[str, Used]:
        """The usage of processes, given their id and group by name; those started after the last look are left out."""
        begun = self._clock()
        if begun >= self._next:
            self._measure(running)
            self._used = {name: self._look(name, *where) for name, where in running.items()}
            ended = self._clock()
            self._next = begun + min(_LONGEST, max(_PAUSE, (ended - begun) / _SHARE))
        there = {name: pid for name, (pid, _) in running.items()}
        return {name: used for name, used in self._used.items() if there.get(name) == used.pid}

    def _measure(self, running: Mapping[str, tuple[int, Path | None]]) -> None:
        """Processes that were never measured come first."""
        there = {(name, pid): group for name, (pid, group) in running.items()}
        for gone in self._measured.keys() - there.keys():
            del self._measured[gone]
        order = {each: at for at, each in enumerate(self._measured)}
        for name, pid in sorted(there, key=lambda each: order.get(each, -1))[:_MEASURED]:
            self._measured.pop((name, pid), None)
            self._measured[name, pid] = _memory(pid, there[name, pid])

    def _look(self, name: str, pid: int, group: Path | None) -> Used:
        trace, at = traces.look(pid), self._clock()
        if trace is None:
            return Used(pid, 0.0, 0, at)
        cpu_s = _cpu_of_group(group) if group else None
        if cpu_s is None:
            cpu_s = trace.cpu_ticks / _TICK
        return Used(pid, cpu_s, self._measured.get((name, pid)) or trace.memory_pages * _PAGE, at)


def _cpu_of_group(group: Path) -> float | None:
    with contextlib.suppress(OSError):
        found = re.search(rb"^usage_usec (\d+)", traces.content(f"{group}/cpu.stat"), re.MULTILINE)
        return int(found[1]) / 1e6 if found else None
    return None


def _memory(pid: int, group: Path | None) -> int:
    """PSS; 0 if it may not be read."""
    total = 0
    for each in (cgroups.members(group) if group else None) or [pid]:
        with contextlib.suppress(OSError):
            found = re.search(rb"^Pss: +(\d+) kB", Path(f"/proc/{each}/smaps_rollup").read_bytes(), re.MULTILINE)
            total += int(found[1]) * 1024 if found else 0
    return total
