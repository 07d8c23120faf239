"""Processes of our own, which end with us."""

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
    """A process that is asked to end, and made to if it does not. Not told by Ctrl-C, but by us.

    One with a standard input of its own is asked by the end of that, so that it can close what it has opened.
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
    """A folder for sockets, whose paths have 107 bytes at most. What a killed run left is removed by the next one."""
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
    """What a process has computed so far, its kernel time included, by its own clock: `ps` counts in steps of 10 ms."""
    return time.clock_gettime(~pid << 3 | _SCHEDULED)


def megabytes(pid: int, what: str = "Pss") -> float:
    """Memory of a process: `Pss` is its share, `Rss` includes what it shares with others."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        name, _, value = line.partition(":")
        if name == what:
            return int(value.split()[0]) / 1000
    raise ValueError(f"smaps_rollup has no {what}")
