"""Child processes, which end with this process."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from .parties import PATIENCE

ROOT = Path(__file__).parents[1]

_SCHEDULED = 2
"""Of a process's clocks, the one that the scheduler keeps, exactly (`CPUCLOCK_SCHED`; see clock_getcpuclockid(3))."""


@contextlib.contextmanager
def running(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is asked to end, and killed if it does not. It does not receive Ctrl-C.

    A process with its own standard input is asked by closing that, so that it can clean up.
    """
    process: subprocess.Popen[bytes] = subprocess.Popen(command, start_new_session=True, **options)
    try:
        yield process
    finally:
        if process.stdin:
            process.stdin.close()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(PATIENCE / 2)
        process.terminate()
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextlib.contextmanager
def folder() -> Iterator[str]:
    """A folder for sockets, whose paths have at most 107 bytes. The next run removes leftovers of a killed one."""
    for left in Path("/tmp").glob("rcb-*-*"):
        if not Path("/proc", left.name.split("-")[1]).exists():
            shutil.rmtree(left, ignore_errors=True)
    path = Path("/tmp", f"rcb-{os.getpid()}-{os.urandom(3).hex()}")
    path.mkdir(mode=0o700)
    try:
        yield str(path)
    finally:
        shutil.rmtree(path, ignore_errors=True)


def cpu_seconds(pid: int) -> float:
    """The CPU time of a process so far, including kernel time, by its own clock: `ps` counts in steps of 10 ms."""
    return time.clock_gettime(~pid << 3 | _SCHEDULED)


def megabytes(pid: int, what: str = "Pss") -> float:
    """Memory of a process: `Pss` is its share, `Rss` includes what it shares with others."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        name, _, value = line.partition(":")
        if name == what:
            return int(value.split()[0]) / 1000
    raise ValueError(f"smaps_rollup has no {what}")
