"""Waits in the code of a component, on its clock, that end early when the component stops."""

from __future__ import annotations

import threading
from collections.abc import Callable

from ..contract.component import MAX_SECONDS
from .clock import NEVER, Clock, ns
from .lifecycle import State
from .monitor import Monitor

_STOPPING = (State.FINISH, State.ENDED)


class Sleepers:
    """The threads of one component that wait in its code. Handlers may run meanwhile."""

    def __init__(self, clock: Clock, monitor: Monitor, state: Callable[[], State]) -> None:
        """`state` is that of the component."""
        self._clock, self._monitor, self._state = clock, monitor, state
        self._lock = threading.Lock()
        self._waking: set[threading.Event] = set()

    def sleep(self, seconds: float) -> bool:
        """Wait; False if the component is asked to stop meanwhile. Raises ValueError if the time is out of bounds."""
        if not 0 <= seconds <= MAX_SECONDS:
            raise ValueError(f"a component sleeps for 0 to {MAX_SECONDS:g} seconds, not {seconds!r}")
        return self.wait(seconds, bool, threading.Event())

    def wait(self, seconds: float | None, condition: Callable[[], bool], wake: threading.Event) -> bool:
        """As `sleep`, but not longer than until a condition holds, which is looked at when the event is set.

        `finish` may wait too, until the component has ended.
        """
        until = NEVER if seconds is None else self._clock.now() + ns(seconds)
        over = (State.ENDED,) if self._state() is State.FINISH else _STOPPING
        with self._lock:
            self._waking.add(wake)
        try:
            with self._monitor.suspended():
                while self._state() not in over and not condition() and self._clock.reached() < until:
                    if self._clock.wait(wake, until):
                        wake.clear()
        finally:
            with self._lock:
                self._waking.discard(wake)
        return self._state() not in over

    def wake(self) -> None:
        """Let all of them look at the state of the component, which has changed."""
        with self._lock:
            waking = list(self._waking)
        for each in waking:
            each.set()
