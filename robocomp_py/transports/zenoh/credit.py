"""How far a sender may go ahead of its readers, for middleware that loses what a slow reader has no room for."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

BYTES_AHEAD = 512 * 1024
"""About so many bytes may be on their way to a reader; of larger messages, one.

It is what the queues on the way hold without any waiting in them: 1 MB, shared by a few senders.
"""


class Credit:
    """How far a sender may go ahead of its readers: `ahead` messages that a reader has not taken yet.

    `readers` tells who there is, and since when: any number that is another one if it went and came
    back. What was on its way to it then may be lost, and will never be taken.
    """

    def __init__(self, ahead: int, readers: Callable[[], Mapping[int, int]]) -> None:
        self._ahead, self._readers = ahead, readers
        self._changed = threading.Condition()
        self._taken: dict[int, tuple[int, int]] = {}
        """Of each reader, since when it is there, and the number up to which it took what was sent."""
        self.sent = 0

    def wait(self, end: float, still: Callable[[], object], size: int = 0) -> bool:
        """Wait until one more, of `size` bytes, may be sent, and count it; `still` is called meanwhile, may raise."""
        ahead = min(self._ahead, BYTES_AHEAD // size or 1) if size else self._ahead
        while True:
            with self._changed:
                if self._furthest() < ahead:
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
            since, taken = self._taken.get(reader, (0, sequence))
            if sequence > taken:
                self._taken[reader] = since, min(sequence, self.sent)
                self._changed.notify_all()

    def _furthest(self) -> int:
        """How many messages the slowest reader is behind."""
        there = self._readers()
        for reader, since in there.items():
            if reader not in self._taken or self._taken[reader][0] != since:
                self._taken[reader] = since, self.sent
        if len(self._taken) > len(there):
            self._taken = {reader: self._taken[reader] for reader in there}
        return max((self.sent - taken for _, taken in self._taken.values()), default=0)
