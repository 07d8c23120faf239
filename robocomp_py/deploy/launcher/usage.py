"""How much processor time and memory processes use, asked for at most now and then."""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from . import cgroups, traces

_AGE = 2.0
"""Seconds for which figures are good."""

_MEASURED = 20
"""So many processes have their memory measured at a time, which is dear; of the others the last figure holds."""

_TICK = os.sysconf("SC_CLK_TCK")
_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True)
class Used:
    cpu_s: float
    memory: int


class Meter:
    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._at = -_AGE
        self._used: dict[str, Used] = {}
        self._measured: dict[str, int] = {}
        """Bytes by name; who was measured last comes last."""

    def read(self, running: Mapping[str, tuple[int, Path | None]]) -> Mapping[str, Used]:
        """Of processes, given their id and group by name."""
        if self._clock() - self._at >= _AGE:
            self._at = self._clock()
            self._measure(running)
            self._used = {name: self._look(name, *where) for name, where in running.items()}
        return self._used

    def _measure(self, running: Mapping[str, tuple[int, Path | None]]) -> None:
        order = {name: at for at, name in enumerate(self._measured)}
        for name in sorted(running, key=lambda each: order.get(each, -1))[:_MEASURED]:
            self._measured.pop(name, None)
            self._measured[name] = _memory(*running[name])
        for name in self._measured.keys() - running.keys():
            del self._measured[name]

    def _look(self, name: str, pid: int, group: Path | None) -> Used:
        trace = traces.look(pid)
        if trace is None:
            return Used(0.0, 0)
        cpu_s = _cpu_of_group(group) if group else None
        return Used(
            trace.cpu_ticks / _TICK if cpu_s is None else cpu_s,
            self._measured.get(name) or trace.memory_pages * _PAGE,
        )


def _cpu_of_group(group: Path) -> float | None:
    with contextlib.suppress(OSError):
        found = re.search(r"^usage_usec (\d+)", (group / "cpu.stat").read_text(), re.MULTILINE)
        return int(found[1]) / 1e6 if found else None
    return None


def _memory(pid: int, group: Path | None) -> int:
    """PSS; 0 if it is not for us to know."""
    total = 0
    for each in (cgroups.members(group) if group else None) or [pid]:
        with contextlib.suppress(OSError):
            found = re.search(rb"^Pss: +(\d+) kB", Path(f"/proc/{each}/smaps_rollup").read_bytes(), re.MULTILINE)
            total += int(found[1]) * 1024 if found else 0
    return total
