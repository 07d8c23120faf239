"""Limits how often an event is logged that peers can cause at any rate."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable

FIRST = 5
PAUSE = 10.0
"""Seconds between two log lines after the first ones."""


class Sparing:
    """Allows the first few of many similar log lines, then one in ten seconds."""

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
    """Allows one log line in ten seconds for each kind of event."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._told: dict[Hashable, tuple[float, int]] = {}
        """By kind: when it may be logged again, and how many lines were left out."""

    def untold(self, way: Hashable) -> int | None:
        """The number of lines left out since the last one, if this one is to be logged; None if it is left out, too."""
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
"""Maximum number of kinds that are remembered."""
