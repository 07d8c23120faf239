"""Hands a task of the clock over between the loop of a component and a backup thread.

The task of a leader is to ask its followers, and that of a follower is to answer its leader. One thread at a time does
it:

    loop      does the task while it waits for the clock. When the loop is due, it runs code of the component. Then it
              waits again, and goes on with the task.
    backup    does the task when the loop cannot: the loop is about to block, or its code takes longer than 20 ms.

So at an instant, no thread has to wake up besides the loops.
"""

from __future__ import annotations

import threading
from typing import Protocol

from ..threads import start_thread
from ..transports.base import receives
from .cores import run_on, stay_on
from .pollable import PollableEvent

_SOON = 0.02
"""Seconds after which the backup thread takes over from a loop that runs code of the component."""

_QUIET = 25
"""Number of checks in a row without an instant after which the backup thread stops checking."""

_STUCK = 5.0
"""Seconds that `close` waits for the thread, and after which the backup thread looks whether it is closed."""


class Task(Protocol):
    """The task that is handed over. One thread at a time does it, and goes on where the last one has stopped."""

    @property
    def is_for_loop(self) -> bool:
        """Whether the loop may do it now."""
        ...

    def core(self) -> int:
        """The core on which the loop should wait; ANY_CORE if that does not matter. Called on the loop's thread."""
        ...

    def serve(self, wake: PollableEvent, timeout: float, *, is_loop: bool) -> bool:
        """Do the task until the event of the calling thread is set, or until the loop, if that calls, is due.

        Returns True in these cases. Returns False if the loop should no longer do the task, or if there was nothing to
        do for `timeout` seconds.
        """
        ...


class Handover:
    """Call `begin`, then `wait` on the thread of the loop, then `close`. Before `close`, the task is told to end."""

    def __init__(self, name: str, task: Task) -> None:
        """`name` is that of the backup thread."""
        self.wake, self.backup_wake = PollableEvent(), PollableEvent()
        """For the loop, and for the backup thread."""
        self._task = task
        self._thread = threading.Thread(target=self._run_backup, name=name, daemon=True)
        self._is_registered = False
        """Whether the transports call `_hand_over` before the loop blocks."""
        self._is_closed = False
        self._lock = threading.Lock()
        self._is_requested = False
        """Whether the loop has asked for the task."""
        self._is_with_loop = False
        """Whether the loop has the task; otherwise the backup thread has it."""
        self._is_loop_busy = False
        """Whether the loop has the task, but runs code of the component."""
        self._times_busy = 0
        """How often that has begun."""
        self._is_watched = False
        """Whether the backup thread checks every 20 ms that the loop is back."""

    def begin(self) -> bool:
        """Returns False if the system cannot start a thread."""
        for each in (self.wake, self.backup_wake):
            each.wakeup.open()
        return start_thread(self._thread)

    def close(self) -> None:
        """Idempotent."""
        self._is_closed = True
        self.backup_wake.set()
        if self._thread.ident:
            self._thread.join(_STUCK)
        for each in (self.wake, self.backup_wake):
            each.wakeup.close()

    # The loop.

    def wait(self, wake: threading.Event, timeout: float) -> bool:
        """Like `wake.wait(timeout)`. If `wake` is the event of the loop, the task is done meanwhile, and it may return
        False before the timeout."""
        if wake is not self.wake:
            return wake.wait(timeout)
        with self._lock:
            self._is_loop_busy = False
            has_task = self._is_with_loop
            asks = not has_task and not self._is_requested and self._task.is_for_loop
            self._is_requested |= asks
        if asks:
            self.backup_wake.set()
        if not has_task:
            return wake.wait(timeout)
        if not self._is_registered:
            self._is_registered = True
            receives(self._hand_over)
        cores = stay_on(self._task.core())
        try:
            return self._task.serve(self.wake, timeout, is_loop=True)
        finally:
            if cores:
                run_on(cores)
            with self._lock:
                self._is_loop_busy = True
                self._times_busy += 1
                self._is_with_loop = self._task.is_for_loop
                asks = not self._is_with_loop or not self._is_watched
                self._is_watched = self._is_with_loop
            if asks:
                self.backup_wake.set()

    def _hand_over(self) -> None:
        """Give the task to the backup thread, because the loop is about to block."""
        with self._lock:
            leaves = self._is_with_loop and self._is_loop_busy
            if leaves:
                self._is_with_loop = False
        if leaves:
            self.backup_wake.set()

    # The backup thread.

    def _run_backup(self) -> None:
        while not self._is_closed:
            with self._lock:
                self.backup_wake.clear()
                hands_over, self._is_requested = self._is_requested and self._task.is_for_loop, False
                if hands_over:
                    self._is_with_loop, self._is_loop_busy = True, True
                    self._times_busy += 1
                has_task = self._is_with_loop
            if hands_over:
                self.wake.set()  # it finds that nothing is due, and waits again
            if has_task:
                self._watch_loop()
            elif not self._is_closed:
                self._task.serve(self.backup_wake, _STUCK, is_loop=False)

    def _watch_loop(self) -> None:
        """Return when the loop no longer has the task."""
        quiet = 0
        while not self._is_closed:
            times_busy, was_busy = self._times_busy, self._is_loop_busy
            is_called = self.backup_wake.wait(_SOON if self._is_watched else None)
            with self._lock:
                self.backup_wake.clear()
                if not self._is_with_loop:
                    return
                quiet = 0 if is_called or times_busy != self._times_busy else quiet + 1
                if quiet and was_busy and self._is_loop_busy:
                    self._is_with_loop = False
                    return
                self._is_watched = quiet < _QUIET
