"""How far a sender may go ahead of its readers, for middleware that loses what a slow reader has no room for."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping

from .limits import BYTES_AHEAD


class Credit:
    """How far a sender may go ahead of its readers: `ahead` messages that a reader has not taken yet.

    `readers` tells who there is, and since when: any number that is another one if it went and came
    back. What was on its way to it then may be lost, and will never be taken. Readers may tell what
    they took by a single number for many messages. One thread at a time sends.
    """

    def __init__(self, ahead: int, readers: Callable[[], Mapping[int, int]]) -> None:
        self._ahead, self._readers = ahead, readers
        self._changed = threading.Condition()
        self._taken: dict[int, tuple[int, int]] = {}
        """Of each reader, since when it is there, and the number up to which it took what was sent."""
        self._floor = -ahead
        """What all had taken at the last look; so far ahead at first, that there is one before anything is sent."""
        self._sizes: deque[int] = deque()
        """Of what was sent after that."""
        self._bytes = 0
        self.sent = 0

    def claim(self, size: int = 0) -> bool:
        """Count one more message as sent, if it may be for all that is known without a look at the readers.

        So a new one may be left out of account for `ahead` messages.
        """
        if self.sent - self._floor >= self._ahead or self._bytes >= BYTES_AHEAD:
            return False
        self.sent += 1
        self._sizes.append(size)
        self._bytes += size
        return True

    def wait(self, end: float, still: Callable[[], object], size: int = 0) -> bool:
        """Wait until one more, of `size` bytes, may be sent, and count it; `still` is called meanwhile, may raise."""
        while True:
            with self._changed:
                self._look()
                if self.claim(size):
                    return True
                left = end - time.monotonic()
                if left > 0:
                    self._changed.wait(min(left, 0.05))
            still()
            if left <= 0:
                return False

    def took(self, reader: int, sequence: int) -> None:
        with self._changed:
            since, taken = self._taken.get(reader, (0, sequence))
            if sequence > taken:
                self._taken[reader] = since, min(sequence, self.sent)
                self._changed.notify_all()

    def _look(self) -> None:
        """Find out what the slowest reader has taken."""
        there = self._readers()
        for reader, since in there.items():
            if reader not in self._taken or self._taken[reader][0] != since:
                self._taken[reader] = since, self.sent
        if len(self._taken) > len(there):
            self._taken = {reader: self._taken[reader] for reader in there}
        self._floor = min((taken for _, taken in self._taken.values()), default=self.sent)
        while len(self._sizes) > self.sent - self._floor:
            self._bytes -= self._sizes.popleft()
