"""On which core a thread runs, and how to keep it there."""

from __future__ import annotations

import logging
import os
from pathlib import Path

log = logging.getLogger("robocomp.clock")

ANY_CORE = -1
"""In place of the number of a core."""


def present_core() -> int:
    """The core on which the calling thread runs; ANY_CORE if the system does not tell, or cannot keep it there."""
    if not hasattr(os, "sched_setaffinity"):
        return ANY_CORE
    try:
        stat = Path("/proc/thread-self/stat").read_text(encoding="ascii", errors="replace")
        return int(stat.rpartition(")")[2].split()[36])
    except (OSError, ValueError, IndexError):
        return ANY_CORE


def stay_on(core: int) -> set[int]:
    """Keep the calling thread on one core. Returns the cores on which it could run before; empty if it is not kept.

    The components of a network in lock-step compute one after the other, and to wake a thread on another core takes
    three times as long as on the same one. User code, and the threads that it starts, may run on all cores.
    """
    if core == ANY_CORE:
        return set()
    allowed = os.sched_getaffinity(0)
    return allowed if len(allowed) > 1 and core in allowed and run_on({core}) else set()


def run_on(cores: set[int]) -> bool:
    """Let the calling thread run on these cores only. Returns False if the system does not allow that."""
    try:
        os.sched_setaffinity(0, cores)
    except OSError as exc:
        log.debug("a loop cannot run on the cores %s: %s", cores, exc)
        return False
    return True
