"""A fair queue of requests: those of one sender in order, the senders in turn.

In a plain queue, others would wait behind all requests of a fast sender. With turns, they wait for one of them.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Turns(Generic[T]):
    """A queue. Its length is the number of requests that wait. Safe to use from any thread."""

    def __init__(self, octets_of: Callable[[T], int] | None = None) -> None:
        """`octets_of` returns the size of a request; only with it, `octets` is counted."""
        self._octets_of = octets_of
        self.octets = 0
        """The total size of the waiting requests."""
        self._lock = threading.Lock()
        self._waiting: dict[int, deque[T]] = {}
        """By sender; the sender whose turn is next comes first."""
        self._size = 0

    def __len__(self) -> int:
        return self._size

    def add(self, sender: int, request: T) -> None:
        with self._lock:
            self._size += 1
            if self._octets_of:
                self.octets += self._octets_of(request)
            requests = self._waiting.get(sender)
            if requests is None:
                self._waiting[sender] = deque((request,))
            else:
                requests.append(request)

    def take(self) -> T:
        """The next request. Raises IndexError if there is none."""
        with self._lock:
            if not self._size:
                raise IndexError("no request waits")
            self._size -= 1
            sender = next(iter(self._waiting))
            requests = self._waiting.pop(sender)
            request = requests.popleft()
            if self._octets_of:
                self.octets -= self._octets_of(request)
            if requests:
                self._waiting[sender] = requests  # at the end: the others have their turn first
            return request
