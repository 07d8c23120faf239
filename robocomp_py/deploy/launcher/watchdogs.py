"""The watchdogs of processes: which ones have to report, and by when."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

_LATE = 1.0
"""Seconds by which we come too late to judge others: then we were stopped ourselves."""


class Watchdogs:
    """Watches processes that have fed their watchdog once. Calls `hung(name)` for one that is silent too long."""

    def __init__(self, loop: asyncio.AbstractEventLoop, hung: Callable[[str], None]) -> None:
        self._loop, self._hung = loop, hung
        self._limits: dict[str, float] = {}
        self._due: dict[str, float] = {}
        self._timer: asyncio.TimerHandle | None = None

    def limit(self, name: str, seconds: float) -> None:
        """Seconds that it may be silent from now on; 0 is without limit."""
        self._limits[name] = seconds
        if name in self._due or not seconds:
            self.feed(name, seconds)

    def feed(self, name: str, limit: float) -> None:
        """It lives. `limit` holds as long as none was set."""
        seconds = self._limits.setdefault(name, limit)
        if not seconds:
            self._due.pop(name, None)
            return
        self._due[name] = self._loop.time() + seconds
        if self._timer is None or self._timer.when() > self._due[name]:
            self._arm(self._due[name])

    def forget(self, name: str) -> None:
        self._limits.pop(name, None)
        self._due.pop(name, None)

    def close(self) -> None:
        self._due.clear()
        if self._timer:
            self._timer.cancel()

    def _arm(self, at: float) -> None:
        if self._timer:
            self._timer.cancel()
        self._timer = self._loop.call_at(at, self._look)

    def _look(self) -> None:
        now = self._loop.time()
        late = now - self._timer.when() if self._timer else 0.0
        self._timer = None
        if late > _LATE:
            self._due = {name: now + self._limits[name] for name in self._due}
        for name in [name for name, due in self._due.items() if due <= now]:
            self._due.pop(name, None)
            self._hung(name)
        if self._due:
            self._arm(min(self._due.values()))
