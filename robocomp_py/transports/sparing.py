"""What others can bring about as often as they like is logged sparingly."""

from __future__ import annotations

import time
from collections.abc import Callable

FIRST = 5
PAUSE = 10.0
"""Seconds."""


class Sparing:
    """Lets the first few of many alike things be told, and later one in ten seconds."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now, self._told, self._next = now, 0, 0.0

    def may_tell(self) -> bool:
        now = self._now()
        if self._told >= FIRST and now < self._next:
            return False
        self._told += 1
        self._next = now + PAUSE
        return True
