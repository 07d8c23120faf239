"""A component's loop without Qt, of which a test is the thread."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from robocomp_py.classic.workers.qt.standin import StandInLoop
from robocomp_py.runtime.clock import Clock, Real
from robocomp_py.testing.patience import SOON


class Component:
    """What a component's files see, and what became of it."""

    def __init__(self, clock: Clock | None = None) -> None:
        self.clock = clock or Real()
        self.told: list[BaseException] = []
        self.outside = 0
        """How many are outside just now."""
        self.woken = self.quits = 0
        self.loop = StandInLoop(self._wake, self._quit, self._outside, self.told.append, self.clock)
        self.loop.call(lambda: None)

    @property
    def QtCore(self) -> Any:
        return self.loop.modules["PySide2.QtCore"]

    @property
    def QtWidgets(self) -> Any:
        return self.loop.modules["PySide2.QtWidgets"]

    def run_until(self, condition: Callable[[], object]) -> None:
        """Do what is due as a component does, until something holds."""
        end = time.monotonic() + SOON
        while not condition():
            assert time.monotonic() < end, "it has not come to that"
            now = self.clock.now()
            if self.loop.due(now) == now:
                self.loop.run(now)
            else:
                time.sleep(0.001)

    def run_all(self) -> None:
        """Do what is due at this moment."""
        now = self.clock.now()
        while self.loop.due(now) == now:
            self.loop.run(now)

    def _wake(self) -> None:
        self.woken += 1

    def _quit(self) -> None:
        self.quits += 1

    @contextmanager
    def _outside(self) -> Iterator[None]:
        self.outside += 1
        try:
            yield
        finally:
            self.outside -= 1
