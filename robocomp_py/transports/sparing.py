"""What others can bring about as often as they like is logged sparingly."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable

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


class Repeats:
    """Of what comes again and again in one of several ways, lets each way be told once in ten seconds."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._told: dict[Hashable, tuple[float, int]] = {}
        """When it may be told again, and how many were not told."""

    def untold(self, way: Hashable) -> int | None:
        """How many were left out since one was told, if this is to be told; None if this is left out, too."""
        now = self._now()
        again, untold = self._told.get(way, (now, 0))
        if now < again:
            self._told[way] = again, untold + 1
            return None
        if len(self._told) >= _MAX_WAYS:
            self._told.clear()
        self._told[way] = now + PAUSE, 0
        return untold


_MAX_WAYS = 100
"""So many are kept in mind."""
