"""A clock that another component moves."""

from __future__ import annotations

import contextlib
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from enum import Enum, auto

from ..runtime.clock import NEVER, SECOND

_SLICE = 0.2
"""Seconds between two looks at whether the clock is still followed."""


class Moved(Enum):
    """Whether a clock was moved, and which thread goes on."""

    NOT = auto()
    """Because a thread works."""
    QUIETLY = auto()
    """None goes on."""
    TO_ASKING = auto()
    """The one that asked for it."""
    TO_OTHER = auto()


class _Waiter:
    """A thread that waits for a clock, or works between two waits, as long as the event by which it waits exists."""

    __slots__ = ("age", "event", "until")

    def __init__(self, event: threading.Event, age: int, working: set[_Waiter]) -> None:
        """It leaves the set `working` at the end of its event."""
        self.event = weakref.ref(event, lambda _: working.discard(self))
        self.age = age
        self.until = 0
        """The instant for which it waits."""

    def is_before(self, other: _Waiter) -> bool:
        return (self.until, self.age) < (other.until, other.age)


class Followed:
    """A time that passes by `proceed`, from the instant at which its component is ready until it ends.

    Before and after that, the time that a component waits passes as on the machine. The clock also knows whether a
    thread that has waited for it works outside of the monitor of the component.
    """

    def __init__(self, is_free: Callable[[], bool]) -> None:
        """`is_free` returns whether no leader moves the clock now: the component is starting, or ending."""
        self._is_free = is_free
        self.pause: Callable[[threading.Event, float], bool] = threading.Event.wait
        """Waits for an event like its `wait`, with a time limit in seconds, and may do other work in the meantime."""
        self._now = 0
        """The time that handlers see."""
        self._reached = 0
        """The time until which hooks and timers that are due may run."""
        self.due_next = NEVER
        """What `due` was when it was moved quietly."""
        self._changed = threading.Lock()
        self._news = threading.Lock()
        """Released when a thread begins to wait, if one is interested."""
        self._is_watched = False
        """Whether a thread waits for news."""
        self._waiting: dict[threading.Event, _Waiter] = {}
        """Those of threads that wait."""
        self._working: set[_Waiter] = set()
        """Those of threads that work. That of a `sleep` is dropped when its thread is inside the monitor again."""
        self._waiters: weakref.WeakKeyDictionary[threading.Event, _Waiter] = weakref.WeakKeyDictionary()
        """In the order in which threads waited for the first time: that of `compute` before that of the timers."""
        self._begun = 0
        """Number of waiters so far."""
        self._own = threading.local()
        """`loop` is the first waiter of this thread, which is that of its loop."""

    def now(self) -> int:
        return self._now

    def reached(self) -> int:
        return self._reached

    def wait(self, wake: threading.Event, until: int) -> bool:
        working = self._working
        with self._changed:
            loop = self._loop_of_this_thread()
            waiter = loop if loop and loop.event() is wake else self._waiter(wake)
            if loop is None:
                loop = self._own.loop = waiter
            if until <= self._reached or wake.is_set():
                working.add(waiter)
                return wake.is_set()
            working.discard(waiter)
            working.discard(loop)
            waiter.until = until
            self._waiting[wake] = waiter
            if self._is_watched:
                self._is_watched = False
                self._news.release()
        try:
            self._wait(wake, until)
        finally:
            with self._changed:
                del self._waiting[wake]
                working.add(waiter)
                working.add(loop)
        return wake.is_set()

    @contextlib.contextmanager
    def away(self) -> Iterator[None]:
        """The calling thread does not count as working while the block runs, which waits for something else."""
        loop = self._loop_of_this_thread()
        with self._changed:
            if loop:
                self._working.discard(loop)
        try:
            yield
        finally:
            if loop:
                with self._changed:
                    self._working.add(loop)

    def show(self, to: int) -> None:
        """Move what `now` returns; it never goes back. What is due then waits for `proceed`."""
        with self._changed:
            self._now = max(self._now, to)

    def proceed(self, to: int, asking: threading.Event | None = None) -> Moved:
        """Move the clock, and wake the thread that waits for the earliest instant that has come; none if one works.

        One thread at a time: call it again once that one waits again. The calling thread itself may wait, by the event
        `asking`. If it is the one to go on, its event is not set.
        """
        with self._changed:
            if self._working:
                return Moved.NOT
            now, due = max(self._now, to), NEVER
            first, wakes = None, None
            for wake, waiter in self._waiting.items():
                if wake.is_set():
                    return Moved.NOT
                if waiter.until > now:
                    due = min(due, waiter.until)
                elif first is None or waiter.is_before(first):
                    first, wakes = waiter, wake
            self._now = self._reached = now
            if first is None or wakes is None:
                self.due_next = due
                return Moved.QUIETLY
            self._working.add(first)
        if wakes is asking:
            return Moved.TO_ASKING
        wakes.set()
        return Moved.TO_OTHER

    @property
    def due(self) -> int:
        """The earliest instant for which a thread waits; NEVER if none does."""
        with self._changed:
            due = NEVER
            for each in self._waiting.values():  # a comprehension costs more, at every instant
                if each.until < due:
                    due = each.until
            return due

    @property
    def is_still(self) -> bool:
        """Whether all threads that use this clock wait, for it or for something else."""
        with self._changed:
            return self._is_still()

    def _is_still(self) -> bool:
        if self._working:
            return False
        for wake in self._waiting:  # noqa: SIM110 - a comprehension costs more, at every instant
            if wake.is_set():
                return False
        return True

    def _loop_of_this_thread(self) -> _Waiter | None:
        """The waiter of the loop that this thread runs; None if it runs none, or if that is over."""
        loop: _Waiter | None = getattr(self._own, "loop", None)
        return loop if loop and loop.event() else None

    def _waiter(self, wake: threading.Event) -> _Waiter:
        """Called with the lock."""
        waiter = self._waiters.get(wake)
        if waiter is None:
            self._begun += 1
            self._waiters[wake] = waiter = _Waiter(wake, self._begun, self._working)
        return waiter

    def _wait(self, wake: threading.Event, until: int) -> None:
        """Wait for the event, or until the time has passed by itself."""
        begun, left = time.monotonic(), (until - self._now) / SECOND
        while not self.pause(wake, _SLICE if until == NEVER or not self._is_free() else min(_SLICE, left)):
            if until == NEVER or not self._is_free():
                begun = time.monotonic()
                continue
            left = (until - self._now) / SECOND - (time.monotonic() - begun)
            if left <= 0:
                with self._changed:
                    self._now = self._reached = max(self._now, until)
                return

    def wait_change(self, timeout: float) -> None:
        """Wait until a thread begins to wait for this clock, at most `timeout` seconds; it may be less."""
        with self._changed:
            self._news.acquire(blocking=False)  # so that it is released once: it may be since an earlier wait timed out
            self._is_watched = True
        self._news.acquire(timeout=timeout)
