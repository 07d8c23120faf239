"""Flow control between a sender and its readers, for middleware that drops messages of slow readers."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping

from .limits import BYTES_AHEAD


class Credit:
    """Lets a sender be at most `ahead` messages ahead of its slowest reader.

    `readers` returns the present readers, each with a number that changes if the reader left and came
    back. Messages on their way to it at that time may be lost; the sender does not wait for them.
    A reader may acknowledge many messages by one number. Only one thread sends at a time.
    """

    def __init__(self, ahead: int, readers: Callable[[], Mapping[int, int]]) -> None:
        self._ahead, self._readers = ahead, readers
        self._changed = threading.Condition()
        self._taken: dict[int, tuple[int, int]] = {}
        """By reader: its number from `readers`, and the last message that it took."""
        self._floor = -ahead
        """The last message that all readers had taken at the last look. The first value forces a look before
        sending."""
        self._sizes: deque[int] = deque()
        """Of the messages sent after `_floor`."""
        self._bytes = 0
        self.sent = 0

    def claim(self, size: int = 0) -> bool:
        """Count one more message as sent, if there is room according to the last look at the readers.

        So a new reader may go unnoticed for `ahead` messages.
        """
        if self.sent - self._floor >= self._ahead or self._bytes >= BYTES_AHEAD:
            return False
        self.sent += 1
        self._sizes.append(size)
        self._bytes += size
        return True

    def wait(self, end: float, still: Callable[[], object], size: int = 0) -> bool:
        """Wait until a message of `size` bytes may be sent, and count it. `still` is called meanwhile, and may
        raise."""
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
