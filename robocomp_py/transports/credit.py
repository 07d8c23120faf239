"""How far a sender may go ahead of its readers, for middleware that loses what a slow reader has no room for."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class Credit:
    """How far a sender may go ahead of its readers: `ahead` messages that a reader has not taken yet."""

    def __init__(self, ahead: int, readers: Callable[[], set[int]]) -> None:
        self._ahead, self._readers = ahead, readers
        self._changed = threading.Condition()
        self._taken: dict[int, int] = {}
        self.sent = 0

    def wait(self, end: float, still: Callable[[], object]) -> bool:
        """Wait until one more may be sent, and count it; `still` is called meanwhile, and may raise."""
        while True:
            with self._changed:
                if self._room():
                    self.sent += 1
                    return True
                left = end - time.monotonic()
                if left > 0:
                    self._changed.wait(min(left, 0.05))
            still()
            if left <= 0:
                return False

    def took(self, reader: int, sequence: int) -> None:
        with self._changed:
            if sequence > self._taken.get(reader, sequence):
                self._taken[reader] = min(sequence, self.sent)
                self._changed.notify_all()

    def _room(self) -> bool:
        there = self._readers()
        self._taken = {reader: self._taken.get(reader, self.sent) for reader in there}
        return all(self.sent - taken < self._ahead for taken in self._taken.values())
