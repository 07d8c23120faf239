"""Waiting in tests: for a condition, never for a while. `$ROBOCOMP_PATIENCE` scales every limit."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

SCALE = float(os.environ.get("ROBOCOMP_PATIENCE", "1"))

SOON = 10.0 * SCALE
"""Seconds after which an expected event counts as missing."""


def wait_until(condition: Callable[[], object], timeout: float = 3 * SOON, what: str = "") -> None:
    """Return as soon as the condition holds; raise AssertionError if it does not in time.

    The default allows for a process that starts first, on a machine with much to do.
    """
    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not in {timeout:g} s: {what or getattr(condition, '__name__', condition)}")
        time.sleep(0.002)
