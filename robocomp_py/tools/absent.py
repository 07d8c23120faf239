"""Hosts that were out of reach when a topic was subscribed to, and when to look for them."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection, Iterable

_FIRST = 2.0
"""Seconds until the first look. Each further one waits twice as long as the one before."""

_LONGEST = 60.0
"""Maximum number of seconds between two looks. For as long, a host that can be asked again is looked for, since its
components may still have to start."""


class Absent:
    """The hosts that still have to be looked for. It is false when none is left.

    Safe to use from any thread; one thread at a time looks for them.
    """

    def __init__(self, hosts: Iterable[str] = (), clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._until = dict.fromkeys(hosts, math.inf)
        """Until when a host is looked for; infinity as long as it cannot be asked."""
        self._pause = _FIRST
        self._next = clock() + _FIRST
        self._lock = threading.Lock()

    def __bool__(self) -> bool:
        return bool(self._until)

    def __contains__(self, host: str) -> bool:
        return host in self._until

    def add(self, host: str) -> None:
        self._until[host] = math.inf

    def is_due(self) -> bool:
        """Whether it is time for a look. If so, the caller looks, and calls `looked`; until then, it returns False."""
        with self._lock:
            if not self._until or self._clock() < self._next:
                return False
            self._next = math.inf
            return True

    def found(self, host: str) -> None:
        """Look no longer for a host, since it is heard."""
        self._until.pop(host, None)

    def looked(self, lost: Collection[str] | None = None) -> None:
        """Call this when a look has ended. `lost` are the hosts that could not be asked; None if the look failed."""
        now = self._clock()
        for host, until in list(self._until.items()):
            if lost is None or host in lost:
                self._until[host] = math.inf
            elif until < now:
                del self._until[host]
            else:
                self._until[host] = min(until, now + _LONGEST)
        self._pause = min(2 * self._pause, _LONGEST)
        self._next = now + self._pause
