"""Probes whether a visible link can be reached. Does not depend on Zenoh itself.

A router announces links on other hosts before it has a route to them. For about 0.1 s after two routers have
connected, messages to such links are lost without a notice. So a link behind another router counts as reached only
when it has answered a probe, which is harmless and takes the same route as other messages.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from .table import Token

RETRY_AFTER = 0.02
"""Seconds between two probes of a link."""

PROBE_TIMEOUT = 2.0
"""Seconds after which a link without an answer counts as reached: its program may not answer probes at all."""

Probe = Callable[[Token, Callable[[], None], Callable[[], None]], None]
"""Probe a link: calls the first function when the link answers, and the second when the probe ends, on any thread."""


class Reachability:
    """Probes each link until it answers. Safe to use from any thread."""

    def __init__(
        self,
        probe: Probe,
        there: Callable[[Token], bool],
        reached: Callable[[Token], None],
        due: Callable[[float], None],
    ) -> None:
        """`there`: whether a token still exists; `reached` gets each link that answers; `due`: tick at that time."""
        self._start, self._there, self._reached, self._due = probe, there, reached, due
        self._lock = threading.Lock()
        self._ends: dict[int, float] = {}
        """When the probing of a token ends, by the token's `since`."""
        self._retries: list[tuple[float, Token]] = []
        """The tokens to probe again, and when."""

    def probe(self, token: Token) -> None:
        """Start to probe a link, unless that is going on."""
        with self._lock:
            if token.since in self._ends:
                return
            self._ends[token.since] = time.monotonic() + PROBE_TIMEOUT
        self._probe(token)

    def tick(self, now: float) -> float | None:
        """Repeat the probes that are due; returns the seconds until the next one."""
        with self._lock:
            due = [token for when, token in self._retries if when <= now]
            self._retries = [each for each in self._retries if each[0] > now]
            waits = [when - now for when, _ in self._retries]
        for token in due:
            self._probe(token)
        return min(waits, default=None)

    def _probe(self, token: Token) -> None:
        answered = threading.Event()
        self._start(token, answered.set, lambda: self._settle(token, answered.is_set()))

    def _settle(self, token: Token, answered: bool) -> None:
        again = time.monotonic() + RETRY_AFTER
        with self._lock:
            found = answered or again > self._ends[token.since]
            ends = found or not self._there(token)
            if ends:
                del self._ends[token.since]
            else:
                self._retries.append((again, token))
        if found:
            self._reached(token)
        elif not ends:
            self._due(again)
