"""Whether to wake somebody before what he waits for is written, found out by trying.

To be woken on another core takes some 25 µs on a virtual machine, about as long as Python takes to write a letter;
and both may happen at once. On the same core it means to be woken twice. Which of the two it is, the kernel decides
anew from time to time, and how long a handler takes is not known before. So now and then some calls are made in each
way, and the others in the way that was quicker.
"""

from __future__ import annotations

EVERY = 1024
"""After so many calls it is tried again."""

TRIES = 16
"""Calls in each of the two ways."""

_WORTH_IT = 0.95
"""So much of the time it has to take at most, since it is more work."""


class Haste:
    """For the calls of one link. Those of several threads at once are a worse measure, and nothing else."""

    def __init__(self) -> None:
        self.trying = False
        self._pays = False
        self._calls = -1
        self._taken: tuple[list[float], list[float]] = [], []

    def next(self) -> bool:
        """Whether to hurry this time. If it is being tried, what it took is to be told to `took`."""
        self._calls = number = (self._calls + 1) % EVERY
        if number < 2 * TRIES:
            self.trying = True
            return number % 2 == 1
        if self.trying:
            self.trying = False
            self._decide()
        return self._pays

    def took(self, hurried: bool, seconds: float) -> None:
        self._taken[hurried].append(seconds)

    def _decide(self) -> None:
        usual, hurried = (sorted(each) for each in self._taken)
        if usual and hurried:
            self._pays = hurried[len(hurried) // 2] <= _WORTH_IT * usual[len(usual) // 2]
        self._taken = [], []
