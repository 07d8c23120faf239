"""Tells whoever launched this process that its components get on, as systemd's watchdog wants it.

A component gets on if nobody is at its code, or if it is not the same call of `compute`, a handler or a hook as a while
ago, or if that waits for an answer, which has a deadline. One that waits for its turn says nothing about the one whose
turn it is. Nothing is said before all are ready, so `initialize` takes what time it needs; nor while they stop, which
has its own limit. If the interpreter stands still, so does this.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Protocol

from ..errors import ComponentError
from ..threads import NO_THREAD, start_thread
from .monitor import Monitor
from .notify import CALLS, LIFE, watchdog_s

_OFTEN = 2.0
"""Seconds between two messages, at most."""


class Watched(Protocol):
    """A component of this process."""

    @property
    def monitor(self) -> Monitor: ...
    @property
    def is_up(self) -> bool:
        """Whether it is ready, and not about to end."""

    @property
    def is_over(self) -> bool: ...
    @property
    def life(self) -> str:
        """How it is, in a line for its launcher."""


class Watchdog:
    """While entered, `tell` is given what the launcher is to know, from a thread of its own, if it wants to know."""

    def __init__(self, every: Sequence[Watched], wishes: Sequence[float | None], tell: Callable[[str], None]) -> None:
        """`wishes` are what the configurations of the components say, in seconds; 0: as long as it takes."""
        self._every, self._tell = every, tell
        given = watchdog_s()
        own = [each for each in wishes if each is not None]
        self._limit = 0.0 if 0.0 in own else max(own, default=given)
        self._changed = self._limit != given
        self._pause = min(_OFTEN, self._limit / 3) if self._limit else _OFTEN
        self._seen: dict[int, tuple[int | None, int]] = {}
        self._was_silent = True
        self._lives: dict[int, str] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watchdog") if given else None

    def __enter__(self) -> None:
        if self._thread and not start_thread(self._thread):
            raise ComponentError(f"the launcher cannot be told that the component lives: {NO_THREAD}")

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        if self._thread:
            self._thread.join()

    def _run(self) -> None:
        begun = time.monotonic()
        while not self._ended.wait(self._pause):
            there = [each for each in self._every if not each.is_over]
            if not there or not all(each.is_up for each in there):
                continue
            now = time.monotonic()
            lines = [*self._feed(there), *self._measure(now - begun), *self._look(there)]
            begun = now
            if lines:
                self._tell("\n".join(lines))

    def _feed(self, there: Sequence[Watched]) -> list[str]:
        before, self._seen = self._seen, {id(each): each.monitor.turn() for each in there}
        stuck = any(turn[0] is not None and before.get(who) == turn for who, turn in self._seen.items())
        changed = [f"WATCHDOG_USEC={round(self._limit * 1e6)}"] if self._changed else []
        self._changed = False
        return changed if stuck or not self._limit else [*changed, "WATCHDOG=1"]

    def _look(self, there: Sequence[Watched]) -> list[str]:
        """How each is, if that has changed."""
        before, self._lives = self._lives, {id(each): each.life for each in there}
        return [f"{LIFE}{life}" for who, life in self._lives.items() if before.get(who, "") != life]

    def _measure(self, seconds: float) -> list[str]:
        taken = [each.monitor.gauge.take() for each in self._every]
        answered, slowest = sum(number for number, _ in taken), max(slow for _, slow in taken)
        was_silent, self._was_silent = self._was_silent, not answered
        return [] if was_silent and not answered else [f"{CALLS}{answered / seconds:.4g} {1000 * slowest:.4g}"]
