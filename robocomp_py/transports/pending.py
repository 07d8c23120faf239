"""Calls under way: each ends once, by an answer, by its deadline, by failure or by being cancelled."""

from __future__ import annotations

import threading
import time
from collections.abc import Hashable
from concurrent.futures import Future

from ..errors import Timeout, TransportError
from .base import Reply


class Pending:
    """The Futures of one caller, by a key of its choice. Safe to use from any thread."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.Lock()
        self._calls: dict[Hashable, tuple[Future[Reply], float, float]] = {}

    def __len__(self) -> int:
        return len(self._calls)

    def add(self, key: Hashable, deadline: float) -> Future[Reply]:
        future: Future[Reply] = Future()
        with self._lock:
            self._calls[key] = future, time.monotonic() + deadline, deadline
        future.add_done_callback(lambda _: self._take(key))
        return future

    def settle(self, key: Hashable, reply: Reply) -> bool:
        """End a call by its answer; False if it has ended already."""
        future = self._take(key)
        if future is None or not future.set_running_or_notify_cancel():
            return False
        future.set_result(reply)
        return True

    def fail(self, key: Hashable, error: TransportError) -> None:
        future = self._take(key)
        if future is not None and future.set_running_or_notify_cancel():
            future.set_exception(error)

    def fail_all(self, error: TransportError) -> None:
        for key in list(self._calls):
            self.fail(key, error)

    def expire(self) -> float | None:
        """End the overdue calls; seconds until the next one is, or None if there is none."""
        with self._lock:
            ends = [(end, key, deadline) for key, (_, end, deadline) in self._calls.items()]
        now = time.monotonic()
        for end, key, deadline in ends:
            if end <= now:
                self.fail(key, Timeout(f"{self._name}: no answer in {deadline:g} s"))
        return min((end - now for end, _, _ in ends if end > now), default=None)

    def _take(self, key: Hashable) -> Future[Reply] | None:
        with self._lock:
            found = self._calls.pop(key, None)
        return found[0] if found else None
