"""Finds out by trial whether to wake a peer before its message is written.

To be woken on another core takes some 25 µs on a virtual machine, about as long as Python takes to write a message;
and both may happen at once. On the same core it means to be woken twice. Which of the two it is, the kernel decides
anew from time to time, and how long a handler takes is not known before. So now and then some calls are made in each
way, and the others in the way that was quicker.
"""

from __future__ import annotations

EVERY = 1024
"""Calls between two trials."""

TRIES = 16
"""Calls in each half of a trial."""

_WORTH_IT = 0.95
"""An early wake-up is used if it takes at most this part of the time, since it is more work."""


class EarlyWakeup:
    """For the calls of one link. Calls of several threads at once only make the measurement less exact."""

    def __init__(self) -> None:
        self.trying = False
        self._pays = False
        self._calls = -1
        self._taken: tuple[list[float], list[float]] = [], []

    def next(self) -> bool:
        """Whether to early this time. If it is being tried, what it took is to be told to `took`."""
        self._calls = number = (self._calls + 1) % EVERY
        if number < 2 * TRIES:
            self.trying = True
            return number % 2 == 1
        if self.trying:
            self.trying = False
            self._decide()
        return self._pays

    def took(self, early: bool, seconds: float) -> None:
        self._taken[early].append(seconds)

    def _decide(self) -> None:
        usual, early = (sorted(each) for each in self._taken)
        if usual and early:
            self._pays = early[len(early) // 2] <= _WORTH_IT * usual[len(usual) // 2]
        self._taken = [], []
