"""When each message of a replay is due. Pure: the clock is passed in."""

from __future__ import annotations

SLOWEST, FASTEST = 1 / 64, 64.0
"""Rates that keys can reach."""


class Pace:
    """Maps a clock to positions in a recording. Both are in ns; the recording begins at 0."""

    def __init__(self, now: int, rate: float = 1.0, *, is_paused: bool = False) -> None:
        self.rate, self.is_paused = rate, is_paused
        self._since, self._position = now, 0

    def position(self, now: int) -> int:
        return self._position if self.is_paused else self._position + round((now - self._since) * self.rate)

    def due(self, position: int) -> int | None:
        """When this position is reached; None while the replay is paused."""
        return None if self.is_paused else self._since + round((position - self._position) / self.rate)

    def toggle(self, now: int) -> None:
        """Pause, or go on."""
        self._position, self._since = self.position(now), now
        self.is_paused = not self.is_paused

    def change_rate(self, factor: float, now: int) -> None:
        """Multiply the rate, between `SLOWEST` and `FASTEST`. A rate outside of them only changes towards them."""
        least, most = min(SLOWEST, self.rate), max(FASTEST, self.rate)
        self._position, self._since = self.position(now), now
        self.rate = min(max(self.rate * factor, least), most)

    def jump(self, position: int, now: int) -> None:
        """Be at this position now."""
        self._position, self._since = position, now
