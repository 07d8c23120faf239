"""A clock that another component moves."""

from __future__ import annotations

import contextlib
import threading
import time
import weakref
from collections.abc import Callable, Iterator

from ..runtime.clock import NEVER, SECOND

_SLICE = 0.2
"""Seconds between two looks at whether the clock is still followed."""


class Followed:
    """A time that passes by `advance`, from the instant at which its component is ready until it ends.

    Before and after that, the time that a component waits passes as on the machine. The clock also knows whether a
    thread that has waited for it works outside of the monitor of the component.
    """

    def __init__(self, is_free: Callable[[], bool]) -> None:
        """`is_free` returns whether nobody moves the clock now: the component is starting, or ending."""
        self._is_free = is_free
        self.pause: Callable[[threading.Event, float], bool] = threading.Event.wait
        """Waits for an event like its `wait`, with a time limit in seconds, and may do other work in the meantime."""
        self._now = 0
        self._changed = threading.Lock()
        self._news = threading.Lock()
        """Released when a thread begins to wait, if one is interested."""
        self._is_watched = False
        """Whether a thread waits for news."""
        self._waiting: dict[threading.Event, int] = {}
        """Until when each thread waits, by its event."""
        self._working: weakref.WeakSet[threading.Event] = weakref.WeakSet()
        """The events of threads that work. That of a `sleep` is dropped when its thread is inside the monitor again."""
        self._ages: weakref.WeakKeyDictionary[threading.Event, int] = weakref.WeakKeyDictionary()
        """In which order threads waited for the first time: that of `compute` before that of the timers."""
        self._own = threading.local()
        """`event` is a weak reference to the first event by which this thread has waited, which is that of its loop."""

    def now(self) -> int:
        return self._now

    def wait(self, wake: threading.Event, until: int) -> bool:
        with self._changed:
            if wake not in self._ages:
                self._ages[wake] = len(self._ages)
            loop = self._loop_of_this_thread(wake)
            if until <= self._now or wake.is_set():
                self._working.add(wake)
                return wake.is_set()
            self._working.discard(wake)
            if loop is not wake:
                self._working.discard(loop)
            self._waiting[wake] = until
            if self._is_watched:
                self._is_watched = False
                self._news.release()
        try:
            self._wait(wake, until)
        finally:
            with self._changed:
                del self._waiting[wake]
                self._working.add(wake)
                if loop is not wake:
                    self._working.add(loop)
        return wake.is_set()

    @contextlib.contextmanager
    def away(self) -> Iterator[None]:
        """The calling thread does not count as working while the block runs, which waits for something else."""
        ref = getattr(self._own, "event", None)
        loop = ref() if ref else None
        with self._changed:
            if loop:
                self._working.discard(loop)
        try:
            yield
        finally:
            if loop:
                with self._changed:
                    self._working.add(loop)

    def set(self, to: int) -> None:
        """Move the clock; it never goes back."""
        with self._changed:
            self._now = max(self._now, to)

    def advance(self, to: int) -> bool:
        """Move the clock, and wake the thread that waits for the earliest instant that has come, if there is one.

        One thread at a time: call it again once that one waits again.
        """
        with self._changed:
            return self._advance(to)

    def proceed(self, to: int) -> bool | None:
        """As `advance`, but None, without waking any, if a thread works."""
        with self._changed:
            return self._advance(to) if self._is_still() else None

    def _advance(self, to: int) -> bool:
        self._now = now = max(self._now, to)
        due = [each for each, until in self._waiting.items() if until <= now and not each.is_set()]
        if not due:
            return False
        first = due[0] if len(due) == 1 else min(due, key=lambda each: (self._waiting[each], self._ages[each]))
        self._working.add(first)
        first.set()
        return True

    @property
    def due(self) -> int:
        """The earliest instant for which a thread waits; NEVER if none does."""
        with self._changed:
            return min(self._waiting.values(), default=NEVER)

    @property
    def is_still(self) -> bool:
        """Whether all threads that use this clock wait, for it or for something else."""
        with self._changed:
            return self._is_still()

    def _is_still(self) -> bool:
        return not self._working and not any(wake.is_set() for wake in self._waiting)

    def _loop_of_this_thread(self, wake: threading.Event) -> threading.Event:
        """The event of the loop that this thread runs; `wake` if it runs none."""
        ref = getattr(self._own, "event", None)
        loop: threading.Event | None = ref() if ref else None
        if loop is None:
            loop, self._own.event = wake, weakref.ref(wake)
        return loop

    def _wait(self, wake: threading.Event, until: int) -> None:
        """Wait for the event, or until the time has passed by itself."""
        begun, left = time.monotonic(), (until - self._now) / SECOND
        while not self.pause(wake, _SLICE if until == NEVER or not self._is_free() else min(_SLICE, left)):
            if until == NEVER or not self._is_free():
                begun = time.monotonic()
                continue
            left = (until - self._now) / SECOND - (time.monotonic() - begun)
            if left <= 0:
                self.set(until)
                return

    def wait_change(self, timeout: float) -> None:
        """Wait until a thread begins to wait for this clock, at most `timeout` seconds; it may be less."""
        with self._changed:
            self._news.acquire(blocking=False)  # so that it is released once: it may be since an earlier wait timed out
            self._is_watched = True
        self._news.acquire(timeout=timeout)
