"""An event for which one thread waits by `poll`, together with sockets, or by `wait`."""

from __future__ import annotations

import contextlib
import os
import threading


class Wakeup:
    """A file descriptor that ends the `poll` of a thread."""

    def __init__(self) -> None:
        self.descriptor = -1
        """-1 while it is not open."""
        self._lock = threading.Lock()

    def open(self) -> None:
        self.descriptor = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def send(self) -> None:
        with self._lock:
            if self.descriptor >= 0:
                os.eventfd_write(self.descriptor, 1)

    def clear(self) -> None:
        """Let the descriptor be polled again. Does nothing if nothing was sent."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self.descriptor)

    def close(self) -> None:
        with self._lock:
            if self.descriptor >= 0:
                os.close(self.descriptor)
                self.descriptor = -1


class PollableEvent(threading.Event):
    """An event for which one thread waits, either by `wait` or by `poll` on its descriptor.

    Since no other thread waits, a lock replaces the condition of an event. That takes a fifth of the time.
    """

    def __init__(self) -> None:
        super().__init__()
        self.wakeup = Wakeup()
        self.is_polling = False
        """Whether the thread polls, or is about to."""
        self._is_on = False
        self._setting = threading.Lock()
        self._released = threading.Lock()
        """Released when the event is set."""
        self._released.acquire()

    def is_set(self) -> bool:
        return self._is_on

    def set(self) -> None:
        with self._setting:
            self._is_on = True
            if self._released.locked():
                self._released.release()
        if self.is_polling:
            self.wakeup.send()

    def clear(self) -> None:
        self._is_on = False
        self._released.acquire(blocking=False)  # the thread may have polled when it was set

    def wait(self, timeout: float | None = None) -> bool:
        """Like that of an event, but it may also return False before the timeout."""
        if not self._is_on:
            self._released.acquire(timeout=-1 if timeout is None else timeout)
        return self._is_on
