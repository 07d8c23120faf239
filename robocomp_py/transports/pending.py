"""Pending calls: each ends once, by a reply, a failure, its deadline, or because it is cancelled."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from functools import partial

from ..errors import Timeout, TransportError
from .base import Reply

Do = Callable[[Callable[[], object]], object]
"""Runs a job, now or on another thread: ending a Future runs its callbacks, which may take long."""


def at_once(job: Callable[[], object]) -> None:
    job()


class Pending:
    """The Futures of one caller, by a key of its choice. Safe to use from any thread."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.Lock()
        self._calls: dict[Hashable, tuple[Future[Reply], float, float]] = {}
        self._closed: TransportError | None = None

    def __len__(self) -> int:
        return len(self._calls)

    def add(self, key: Hashable, deadline: float, end: float | None = None) -> Future[Reply]:
        """Begin a call; once closed, raises the error that `close` was given.

        `end` is when the deadline passes, for a call that has already waited for something.
        """
        future: Future[Reply] = Future()
        end = time.monotonic() + deadline if end is None else end
        with self._lock:
            if self._closed:
                raise self._closed
            self._calls[key] = future, end, deadline
        future.add_done_callback(partial(self._forget, key))
        return future

    def knows(self, key: Hashable) -> bool:
        """Whether this call is pending."""
        return key in self._calls

    def settle(self, key: Hashable, reply: Reply) -> bool:
        """End a call by its reply; False if it has ended already."""
        future = self._take(key)
        if future is None or not future.set_running_or_notify_cancel():
            return False
        future.set_result(reply)
        return True

    def fail(self, key: Hashable, error: TransportError) -> None:
        future = self._take(key)
        if future is not None and future.set_running_or_notify_cancel():
            future.set_exception(error)

    def fail_all(
        self, error: TransportError, *, only: Callable[[Hashable], bool] = lambda key: True, do: Do = at_once
    ) -> None:
        """End all calls, or those with certain keys."""
        with self._lock:
            keys = [key for key in self._calls if only(key)]
        for key in keys:
            do(partial(self.fail, key, error))

    def close(self, error: TransportError) -> None:
        """End all calls now, and refuse new ones."""
        with self._lock:
            self._closed = error
        self.fail_all(error)

    def expire(self, do: Do = at_once) -> float | None:
        """End the overdue calls; seconds until the next one is, or None if there is none."""
        now = time.monotonic()
        with self._lock:
            ends = [(end, key) for key, (_, end, _) in self._calls.items()]
            overdue = [key for end, key in ends if end <= now]
            errors = [self._overdue(key) for key in overdue]
        for key, error in zip(overdue, errors, strict=True):
            do(partial(self.fail, key, error))
        return min((end - now for end, _ in ends if now < end < math.inf), default=None)

    def _overdue(self, key: Hashable) -> Timeout:
        """The error for an overdue call. It also marks the call, so that it is not found overdue again."""
        future, _, deadline = self._calls[key]
        self._calls[key] = future, math.inf, deadline
        return Timeout(f"{self._name}: no answer in {deadline:g} s")

    def _forget(self, key: Hashable, future: Future[Reply]) -> None:
        """The call has ended. Its key may already belong to a new call of another thread."""
        with self._lock:
            found = self._calls.get(key)
            if found and found[0] is future:
                del self._calls[key]

    def _take(self, key: Hashable) -> Future[Reply] | None:
        with self._lock:
            found = self._calls.pop(key, None)
        return found[0] if found else None
