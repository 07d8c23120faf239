"""When the leader of a clock may go on to the next instant: the speed of the clock, pauses and steps."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from ..runtime.clock import NEVER, SECOND, ns

_LOOK = 0.1
"""Longest wait in seconds. Then the leader looks at components that come, go, or have something to do earlier."""

MAX_SPEED = 1e6
MAX_STEP = 1e9
"""Seconds."""


@dataclass(frozen=True)
class Stand:
    """How a clock stands."""

    speed: float
    """Seconds of the clock in one second; 0 for as fast as possible."""
    paused: bool
    """Whether it stands still, and all that was due is done."""


class Pace:
    """Safe to use from any thread. Times are those of the clock, in ns, unless they are said to be of the machine."""

    def __init__(self, speed: float, machine: Callable[[], float] = time.monotonic) -> None:
        """`machine` is the time of the machine in seconds."""
        self._machine = machine
        self._speed, self._paused = speed, False
        self._changed = threading.Condition()
        self._is_over = False
        self._is_busy = False
        """Whether the leader is at work for an instant."""
        self._now = 0
        """The instant of the clock."""
        self._at, self._since = 0.0, machine()
        """A time that the clock had, with parts of a ns, and when that was."""
        self._until: int | None = None
        """The end of a step."""

    @property
    def stand(self) -> Stand:
        with self._changed:
            return Stand(self._speed, self._paused and self._until is None and not self._is_busy)

    @property
    def is_unbound(self) -> bool:
        """Whether the clock may go on at any time: as fast as possible, without a pause or a step."""
        return not self._speed and not self._paused and self._until is None

    def pause(self) -> None:
        with self._changed:
            self._stop()

    def resume(self) -> None:
        with self._changed:
            if self._paused:
                self._until = None
                self._paused, self._since = False, self._machine()
                self._changed.notify_all()

    def set_speed(self, speed: float) -> None:
        """Raises ValueError for a speed that cannot be."""
        if not 0 <= speed <= MAX_SPEED:  # NaN, too
            raise ValueError(f"a speed is a number from 0 to {MAX_SPEED:g}, not {speed!r}")
        with self._changed:
            self._settle()
            self._speed = speed
            self._changed.notify_all()

    def step(self, seconds: float) -> int:
        """Let this time pass, in seconds, and then pause. Returns the time at which that will be.

        A step during a step is added to it. Raises ValueError for a duration that cannot be.
        """
        if not 0 < seconds <= MAX_STEP:
            raise ValueError(f"a step takes a positive number of seconds, at most {MAX_STEP:g}, not {seconds!r}")
        with self._changed:
            self._settle()
            begin = self._now if self._until is None else self._until
            self._paused, self._until = True, begin + ns(seconds)
            self._changed.notify_all()
            return self._until

    def close(self) -> None:
        """End every wait."""
        with self._changed:
            self._is_over = True
            self._changed.notify_all()

    def begin(self, now: int) -> None:
        """The clock starts to pass here."""
        with self._changed:
            self._now, self._at, self._since = now, float(now), self._machine()

    def wait(self, instant: int) -> int | None:
        """Wait until the clock may go on to this instant, the next at which something is due, and return it.

        Returns an earlier one if a step ends before, and None if it is still too early. The leader calls it again when
        all that was due at the instant is done.
        """
        with self._changed:
            self._is_busy = False
            if self._until is not None:
                reached = self._reach(min(instant, self._until))
                if reached >= self._until:
                    self._until, self._at = None, float(reached)
                return reached
            left = self._left(instant)
            if left > 0 and not self._is_over:
                self._changed.wait(min(left, _LOOK))
                left = self._left(instant) if self._until is None else math.inf
            return self._reach(instant) if left <= 0 and not self._is_over else None

    def _reach(self, instant: int) -> int:
        self._is_busy = True
        self._now = max(self._now, instant)
        return self._now

    def _left(self, instant: int) -> float:
        """Seconds of the machine until the clock may go on to an instant."""
        if self._paused or instant == NEVER:
            return math.inf
        if not self._speed:
            return 0.0
        return (instant - self._at) / SECOND / self._speed - (self._machine() - self._since)

    def _stop(self) -> None:
        self._settle()
        self._paused, self._until = True, None
        self._changed.notify_all()

    def _settle(self) -> None:
        """Note what has passed until now, at the present speed."""
        machine = self._machine()
        if not self._paused:
            self._at += (machine - self._since) * SECOND * self._speed
        self._at, self._since = max(self._at, float(self._now)), machine
