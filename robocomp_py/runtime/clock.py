"""The clocks of components. A component is given its clock when it is made; no clock is global.

    Real       the time of this machine: it passes by itself
    Virtual    the time of a test or a simulation: it passes only when it is told to

A clock tells the time in nanoseconds since its epoch, as an int, and never goes back. `compute`, timers and
`on_deadline_missed` follow the clock of the component. Deadlines of calls, leases of processes, retries and the
watchdog follow the machine, because they protect from peers that do not answer.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

SECOND = 1_000_000_000
"""One second, in the unit of clocks."""

NEVER = 2**63 - 1
"""A time that is never reached."""


def ns(seconds: float) -> int:
    """Seconds as nanoseconds."""
    return round(seconds * SECOND)


class Clock(Protocol):
    """What a component needs of a clock. Its methods may be called from any thread."""

    def now(self) -> int:
        """Nanoseconds since the epoch of this clock. Never less than before."""

    def reached(self) -> int:
        """The time until which the component has been allowed to do what is due.

        That is `now`, except in lock-step: handlers may see an instant before the turn of their component has come.
        """

    def wait(self, wake: threading.Event, until: int) -> bool:
        """Wait until a time of this clock, or until the event is set, and return whether it is set.

        It may return earlier: callers look at the clock again. A clock that others drive may let other components run
        meanwhile, on this thread too.
        """


class Real:
    """The time of this machine. Its epoch is the Unix epoch.

    It counts from the system's time at which it was made, and is monotonic: if the system's time is set later, it goes
    on as before, so that differences of two times are right.
    """

    def __init__(self) -> None:
        self._offset = time.time_ns() - time.monotonic_ns()

    def now(self) -> int:
        return time.monotonic_ns() + self._offset

    reached = now

    def wait(self, wake: threading.Event, until: int) -> bool:
        left = (until - self.now()) / SECOND
        return wake.wait(min(left, threading.TIMEOUT_MAX)) if left > 0 else wake.is_set()


class Virtual:
    """A time that passes only by `advance`, and while a component waits. It begins at 0 unless told otherwise.

    An executor of several components passes `waiting`, which is called instead when a component waits in its own code:
    with its event and the time until which it waits. It lets the others run until then and advances the clock.
    """

    def __init__(self, now: int = 0, waiting: Callable[[threading.Event, int], object] | None = None) -> None:
        self._now = now
        self._waiting = waiting

    def now(self) -> int:
        return self._now

    reached = now

    def advance(self, to: int) -> None:
        """Let the time pass until `to`; no effect if that is over."""
        self._now = max(self._now, to)

    def wait(self, wake: threading.Event, until: int) -> bool:
        if self._waiting and not wake.is_set():
            self._waiting(wake, until)
        elif until < NEVER and not wake.is_set():
            self.advance(until)
        elif not wake.is_set():
            raise RuntimeError("nothing is due at any time of this virtual clock, so that waiting for it never ends")
        return wake.is_set()
