"""Tells the launcher of this process that its components make progress, by the protocol of systemd's watchdog.

A component is stuck if the same call of `compute`, a handler or a hook is inside its monitor for a whole interval. A
call that waits for a reply is not inside, and its wait has a deadline. Nothing is sent before all components are
ready, so `initialize` has no limit, nor while they stop, which has its own limit. If the interpreter is blocked, so is
this thread, and the launcher ends the process. Shortly before the limit, the log says where the code is.
"""

from __future__ import annotations

import logging
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

_LATE = 0.9
"""Part of the limit after which the log says what a component is busy with."""

log = logging.getLogger("robocomp.worker")


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
    def busy(self) -> str:
        """What its code is at; "" if it is idle."""

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
        self._fed = time.monotonic()
        """When it last reported progress, or had none to report."""
        self._is_stuck = self._is_told = False
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
        while not self._ended.wait(self._next()):
            there = [each for each in self._every if not each.is_over]
            if not there or not all(each.is_up for each in there):
                self._free()
                continue
            now = time.monotonic()
            lines = [*self._feed(there), *self._measure(now - begun), *self._look(there)]
            begun = now
            if lines:
                self._tell("\n".join(lines))

    def _next(self) -> float:
        """Seconds until the next look. One is just in time to say what a component is busy with."""
        if not self._is_stuck or self._is_told:
            return self._pause
        return min(self._pause, max(0.0, self._fed + _LATE * self._limit - time.monotonic()))

    def _free(self) -> None:
        self._fed, self._is_stuck, self._is_told = time.monotonic(), False, False

    def _warn(self, stuck: Sequence[Watched]) -> None:
        """Say once what the stuck ones are busy with, if the launcher is about to end the process."""
        self._is_stuck = True
        took = time.monotonic() - self._fed
        if self._is_told or took < _LATE * self._limit:
            return
        self._is_told = True
        for each in stuck:
            if busy := each.busy:
                log.error("%s for more than %.3g s; the watchdog ends it after %g s", busy, took, self._limit)

    def _feed(self, there: Sequence[Watched]) -> list[str]:
        before, self._seen = self._seen, {id(each): each.monitor.turn() for each in there}
        same = {each for each, turn in self._seen.items() if turn[0] is not None and before.get(each) == turn}
        stuck = [each for each in there if id(each) in same]
        if stuck and self._limit:
            self._warn(stuck)
        else:
            self._free()
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
