"""Which thread of a component does the duty that its clock needs: that of its loop, or another one.

    loop        does the duty while it waits for the clock; when it is due, it works, then waits again and goes on with
                the duty
    stand-in    a thread that belongs to the helm. It does the duty while the loop does not: if the loop is about to
                block, or does not come back soon

So no other thread has to wake up for an instant.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from pathlib import Path
from typing import Protocol

from ..threads import start_thread
from ..transports.base import receives

log = logging.getLogger("robocomp.clock")

ANY_CORE = -1
"""In place of the number of a core."""

_SOON = 0.02
"""Seconds after which the stand-in takes over from a loop that works."""

_QUIET = 25
"""Looks in a row without an instant after which the stand-in stops looking."""

_STUCK = 5.0
"""Seconds that closing waits for the thread."""


class Bell:
    """Ends the `poll` of a thread."""

    def __init__(self) -> None:
        self.number = -1
        """Of its descriptor; -1 while it is not open."""
        self._lock = threading.Lock()

    def open(self) -> None:
        self.number = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def ring(self) -> None:
        with self._lock:
            if self.number >= 0:
                os.eventfd_write(self.number, 1)

    def silence(self) -> None:
        """After it has rung."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self.number)

    def close(self) -> None:
        with self._lock:
            if self.number >= 0:
                os.close(self.number)
                self.number = -1


class Alarm(threading.Event):
    """The event of one thread, which also ends its `poll`.

    Only that thread waits for it. So a lock will do, which takes a fifth of the time of a condition.
    """

    def __init__(self) -> None:
        super().__init__()
        self.bell = Bell()
        self.is_polled = False
        """Whether the thread polls, or is about to."""
        self._is_on = False
        self._setting = threading.Lock()
        self._rung = threading.Lock()
        """Released when the event is set."""
        self._rung.acquire()

    def is_set(self) -> bool:
        return self._is_on

    def set(self) -> None:
        with self._setting:
            self._is_on = True
            if self._rung.locked():
                self._rung.release()
        if self.is_polled:
            self.bell.ring()

    def clear(self) -> None:
        self._is_on = False
        self._rung.acquire(blocking=False)  # the thread may have polled when it was set

    def wait(self, timeout: float | None = None) -> bool:
        """As that of an event, but it may return earlier."""
        if not self._is_on:
            self._rung.acquire(timeout=-1 if timeout is None else timeout)
        return self._is_on


class Duty(Protocol):
    """What one thread at a time does. It remembers by itself where the last one has stopped."""

    @property
    def is_for_loop(self) -> bool:
        """Whether the loop may do it now."""
        ...

    def core(self) -> int:
        """The core on which the loop, which calls this, should wait; ANY_CORE if that does not matter."""
        ...

    def serve(self, by: Alarm, timeout: float, *, is_loop: bool) -> bool:
        """Do the duty until the alarm of the calling thread is set, or until the loop, which calls, is due.

        Returns whether one of them is so. It may also return False, when the loop should no longer do it, or has had
        nothing to do for `timeout` seconds.
        """
        ...


class Helm:
    """`begin`, then `wait` on the thread of the loop, then `close`. The duty is told to end before."""

    def __init__(self, name: str, duty: Duty) -> None:
        """`name` is that of the stand-in's thread."""
        self.alarm, self.spare = Alarm(), Alarm()
        """That of the loop, and that of the stand-in."""
        self._duty = duty
        self._thread = threading.Thread(target=self._stand_in, name=name, daemon=True)
        self._has_registered = False
        self._is_closed = False
        self._lock = threading.Lock()
        self._is_wanted = False
        """Whether the loop would like to have the duty."""
        self._is_lent = False
        """Whether it has it."""
        self._is_out = False
        """Whether it works in the meantime."""
        self._outs = 0
        """How often it has begun to."""
        self._is_watched = False
        """Whether the stand-in looks from time to time if the loop is back."""

    def begin(self) -> bool:
        """Returns False if the system cannot start a thread."""
        for each in (self.alarm, self.spare):
            each.bell.open()
        return start_thread(self._thread)

    def close(self) -> None:
        """Idempotent."""
        self._is_closed = True
        self.spare.set()
        if self._thread.ident:
            self._thread.join(_STUCK)
        for each in (self.alarm, self.spare):
            each.bell.close()

    # The loop.

    def wait(self, wake: threading.Event, timeout: float) -> bool:
        """As the `wait` of an event. If that is the alarm, the duty is done meanwhile; then it may return earlier."""
        if wake is not self.alarm:
            return wake.wait(timeout)
        with self._lock:
            self._is_out = False
            holds = self._is_lent
            asks = not holds and not self._is_wanted and self._duty.is_for_loop
            self._is_wanted |= asks
        if asks:
            self.spare.set()
        if not holds:
            return wake.wait(timeout)
        if not self._has_registered:
            self._has_registered = True
            receives(self._step_aside)
        cores = _stay_on(self._duty.core())
        try:
            return self._duty.serve(self.alarm, timeout, is_loop=True)
        finally:
            if cores:
                _run_on(cores)
            with self._lock:
                self._is_out = True
                self._outs += 1
                self._is_lent = self._duty.is_for_loop
                asks = not self._is_lent or not self._is_watched
                self._is_watched = self._is_lent
            if asks:
                self.spare.set()

    def _step_aside(self) -> None:
        """Leave the duty to the stand-in, because the loop is about to block."""
        with self._lock:
            leaves = self._is_lent and self._is_out
            if leaves:
                self._is_lent = False
        if leaves:
            self.spare.set()

    # The stand-in.

    def _stand_in(self) -> None:
        while not self._is_closed:
            with self._lock:
                self.spare.clear()
                lends, self._is_wanted = self._is_wanted and self._duty.is_for_loop, False
                if lends:
                    self._is_lent, self._is_out = True, True
                    self._outs += 1
                is_lent = self._is_lent
            if lends:
                self.alarm.set()  # it finds that nothing is due, and waits again
            if is_lent:
                self._look_out()
            elif not self._is_closed:
                self._duty.serve(self.spare, _STUCK, is_loop=False)

    def _look_out(self) -> None:
        """Return when the loop no longer has the duty."""
        quiet = 0
        while not self._is_closed:
            outs, was_out = self._outs, self._is_out
            is_called = self.spare.wait(_SOON if self._is_watched else None)
            with self._lock:
                self.spare.clear()
                if not self._is_lent:
                    return
                quiet = 0 if is_called or outs != self._outs else quiet + 1
                if quiet and was_out and self._is_out:
                    self._is_lent = False
                    return
                self._is_watched = quiet < _QUIET


def _stay_on(core: int) -> set[int]:
    """Keep the calling thread on one core, and return those on which it may run otherwise; none if it is not kept.

    To wake a thread on another core takes three times as long as on the same one, and the components of a network in
    lock-step compute one after the other. Threads that user code starts are not concerned: it runs on all cores.
    """
    if core == ANY_CORE:
        return set()
    allowed = os.sched_getaffinity(0)
    return allowed if len(allowed) > 1 and core in allowed and _run_on({core}) else set()


def _run_on(cores: set[int]) -> bool:
    """Let the calling thread run on these cores only. Returns False if the system does not allow that any more."""
    try:
        os.sched_setaffinity(0, cores)
    except OSError as exc:
        log.debug("a loop cannot run on the cores %s: %s", cores, exc)
        return False
    return True


def present_core() -> int:
    """The core on which the calling thread runs; ANY_CORE if the system does not tell, or lets no thread stay there."""
    if not hasattr(os, "sched_setaffinity"):
        return ANY_CORE
    try:
        stat = Path("/proc/thread-self/stat").read_text(encoding="ascii", errors="replace")
        return int(stat.rpartition(")")[2].split()[36])
    except (OSError, ValueError, IndexError):
        return ANY_CORE
