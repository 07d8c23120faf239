"""Whether a link can be reached that is seen already. Knows nothing of Zenoh itself.

A router tells of links on other hosts before it knows the way to them: for about 0.1 s after two routers have met, what
is sent there is lost, and nobody is told. So a link behind a router that is not ours counts as there only once it has
answered a question: which does no harm, and takes the same way as everything else.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from .table import Token

AGAIN = 0.02
"""Seconds after which is asked again what did not get there."""

PATIENCE = 2.0
"""After so many seconds without an answer it counts as reached: its program may know no such questions."""

Ask = Callable[[Token, Callable[[], None], Callable[[], None]], None]
"""Ask a link for a word: calls the first one, on any thread, when it answers, and the second one when that is over."""


class Reaching:
    """Asks links for a sign of life, each until there is one. Safe to use from any thread."""

    def __init__(
        self, ask: Ask, there: Callable[[Token], bool], reached: Callable[[Token], None], due: Callable[[float], None]
    ) -> None:
        """`there`: whether a token still is; `reached` is told of each that is reached; `due`: tick at that time."""
        self._ask, self._there, self._reached, self._due = ask, there, reached, due
        self._lock = threading.Lock()
        self._sought: dict[int, float] = {}
        """Until when a token is asked, by its `since`."""
        self._silent: list[tuple[float, Token]] = []
        """Whom to ask again, and when."""

    def seek(self, token: Token) -> None:
        """Find out whether it can be reached, unless that is being done."""
        with self._lock:
            if token.since in self._sought:
                return
            self._sought[token.since] = time.monotonic() + PATIENCE
        self._try(token)

    def tick(self, now: float) -> float | None:
        """Ask again whom it is time to; seconds until the next time."""
        with self._lock:
            due = [token for when, token in self._silent if when <= now]
            self._silent = [each for each in self._silent if each[0] > now]
            waits = [when - now for when, _ in self._silent]
        for token in due:
            self._try(token)
        return min(waits, default=None)

    def _try(self, token: Token) -> None:
        answered = threading.Event()
        self._ask(token, answered.set, lambda: self._settle(token, answered.is_set()))

    def _settle(self, token: Token, answered: bool) -> None:
        again = time.monotonic() + AGAIN
        with self._lock:
            found = answered or again > self._sought[token.since]
            ends = found or not self._there(token)
            if ends:
                del self._sought[token.since]
            else:
                self._silent.append((again, token))
        if found:
            self._reached(token)
        elif not ends:
            self._due(again)
