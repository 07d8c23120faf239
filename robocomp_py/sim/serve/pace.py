"""How fast a scene goes on: it follows a clock at some factor, or stands still."""

from __future__ import annotations

import logging
import math

log = logging.getLogger("robocomp.sim")

_MOST_MADE_UP = 1.0
"""How much time of the clock is made up for at once, s."""

_WINDOW = 1.0
"""How much time of the clock the factor that was reached is an average of, s."""


class Pace:
    """Tells how many ticks are due. Times are those of a clock, in ns."""

    def __init__(self, tick: float, now: int) -> None:
        """`tick` is the length of a tick, s."""
        self._tick = tick
        self.speed = 1.0
        """The factor; 0: as fast as possible."""
        self.is_paused = False
        self.reached = 0.0
        """Simulated seconds in a second of the clock, in the last second or before."""
        self._is_late = False
        """Whether it was told that the scene is late: once, until it has kept pace again."""
        self._since, self._from, self._expected = now, 0, 0
        self._marked, self._mark = now, 0

    def follow(self, now: int, ticks: int) -> int:
        """The ticks that are due of a scene that has gone on by `ticks`. Of a long delay, only the end is made up for.

        If the scene has gone on by more or less than what was due before, it follows the clock from now on.
        """
        self._measure(now, ticks)
        if self.is_paused or self.speed == 0.0 or ticks != self._expected:
            self._since, self._from, self._expected = now, ticks, ticks
            return 0
        due = self._ticks(now - self._since) - (ticks - self._from)
        most = self._ticks(round(_MOST_MADE_UP * 1e9))
        if due > most:
            if not self._is_late:
                text = "the scene is %.1f s late, and makes up for %g s at most: it has too much to compute"
                log.warning(text, due * self._tick / self.speed, _MOST_MADE_UP)
            self._is_late = True
            due, self._since, self._from = most, now, ticks + most
        elif due < most / 2:
            self._is_late = False
        self._expected = ticks + max(due, 0)
        return max(due, 0)

    def owe(self, count: int) -> None:
        """Note that the scene did not go on by so many of the ticks that were due: they still are."""
        self._expected -= count

    def set_speed(self, factor: float, now: int, ticks: int) -> None:
        """Follow the clock at another factor from now on. Raises ValueError for a factor outside of 0 to 1000."""
        if not math.isfinite(factor) or not 0.0 <= factor <= 1000.0:
            raise ValueError(f"a speed of {factor:g}: it is from 0, for as fast as possible, to 1000")
        self.speed = factor
        self._since, self._from, self._expected = now, ticks, ticks

    def _ticks(self, passed: int) -> int:
        return round(passed / 1e9 * self.speed / self._tick)

    def _measure(self, now: int, ticks: int) -> None:
        passed = (now - self._marked) / 1e9
        if ticks < self._mark:
            self._marked, self._mark = now, ticks
        elif passed >= _WINDOW:
            self.reached = (ticks - self._mark) * self._tick / passed
            self._marked, self._mark = now, ticks
