"""Tells the launcher of this process that its components make progress, by the protocol of systemd's watchdog.

A component is stuck if the same call of `compute`, a handler or a hook is inside its monitor for a whole interval. A
call that waits for a reply is not inside, and its wait has a deadline. Nothing is sent before all components are
ready, so `initialize` has no limit, nor while they stop, which has its own limit. If the interpreter is blocked, so is
this thread, and the launcher ends the process.
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
        """Whether it is ready and not stopping."""

    @property
    def is_over(self) -> bool: ...
    @property
    def life(self) -> str:
        """Its status, as one line for its launcher."""


class Watchdog:
    """While entered, sends messages by `tell`, from a thread of its own, if the launcher has asked for them."""

    def __init__(self, every: Sequence[Watched], wishes: Sequence[float | None], tell: Callable[[str], None]) -> None:
        """`wishes` are the limits in the configurations of the components, in seconds; 0: no limit."""
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
            raise ComponentError(f"the watchdog cannot start: {NO_THREAD}")

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
        stuck = any(turn[0] is not None and before.get(each) == turn for each, turn in self._seen.items())
        changed = [f"WATCHDOG_USEC={round(self._limit * 1e6)}"] if self._changed else []
        self._changed = False
        return changed if stuck or not self._limit else [*changed, "WATCHDOG=1"]

    def _look(self, there: Sequence[Watched]) -> list[str]:
        """The status of each component, if it has changed."""
        before, self._lives = self._lives, {id(each): each.life for each in there}
        return [f"{LIFE}{life}" for each, life in self._lives.items() if before.get(each, "") != life]

    def _measure(self, seconds: float) -> list[str]:
        taken = [each.monitor.tallies.take() for each in self._every]
        answered, slowest = sum(number for number, _ in taken), max(slow for _, slow in taken)
        was_silent, self._was_silent = self._was_silent, not answered
        return [] if was_silent and not answered else [f"{CALLS}{answered / seconds:.4g} {1000 * slowest:.4g}"]
