"""What workers of RoboComp take from CPython that it does not offer.

what                  written for            if the probe fails
before_threads        CPython 3.11 to 3.13   called later: once all threads have ended that Python waits for
not_awaited           CPython 3.11 to 3.13   Python waits for the thread at the end, however long it runs
exits_noted           any Python             `sys.exit` can always be replaced, and is not documented to be
Pool                  CPython 3.11 to 3.13   Python waits for its threads at the end; its calls are not counted
Condition             CPython 3.11 to 3.13   handlers do not run while a condition is waited for
release_all, retake   CPython 3.11 to 3.13   a lock taken twice is released once while a condition is waited for
use_condition         CPython 3.11 to 3.13   handlers do not run while a barrier is waited for

"""

from __future__ import annotations

import atexit
import concurrent.futures.thread
import contextlib
import sys
import threading
from collections.abc import Callable, Iterator, MutableMapping
from contextlib import AbstractContextManager
from functools import partial
from typing import Any, Protocol, TypeVar

from ...threads import NO_THREAD, start_thread

T = TypeVar("T")

_register: Callable[[Callable[[], None]], None] | None = getattr(threading, "_register_atexit", None)
_awaited: MutableMapping[threading.Thread, Any] | None = getattr(concurrent.futures.thread, "_threads_queues", None)


def before_threads(call: Callable[[], None]) -> None:
    """Have Python call this when the main thread has ended, before it waits for other threads."""
    if _register:
        _register(call)
    else:
        atexit.register(call)


def not_awaited(thread: threading.Thread) -> None:
    """Have Python not wait for this thread of a pool when the process ends."""
    if _awaited is not None:
        _awaited.pop(thread, None)


@contextlib.contextmanager
def exits_noted(note: Callable[[Any], None]) -> Iterator[None]:
    """Within this, `sys.exit` calls `note` with its argument first."""
    before = sys.exit

    def noted(status: Any = None, /) -> Any:
        note(status)
        before(status)

    sys.exit = noted
    try:
        yield
    finally:
        sys.exit = before


POOL = ("_shutdown", "_threads", "_work_queue", "_idle_semaphore", "_max_workers", "_adjust_thread_count")
CONDITION = ("_waiters", "_is_owned", "_release_save", "_acquire_restore")
"""The parts that pools and conditions need."""


def _has(thing: object, parts: tuple[str, ...]) -> bool:
    return all(hasattr(thing, each) for each in parts)


class Pool(concurrent.futures.ThreadPoolExecutor):
    """A pool for whose threads Python does not wait at the end: what they do may be endless."""

    def begun(self, thread: threading.Thread) -> None:
        """A thread was started."""

    @property
    def ended(self) -> bool:
        """Whether it was shut down, if that is known."""
        return self._shutdown if _has(self, POOL) else False

    @property
    def threads(self) -> list[threading.Thread]:
        return list(self._threads) if _has(self, POOL) else []

    @property
    def waiting(self) -> int:
        """The number of waiting calls after it was shut down. The queue's last item is the pool's end marker."""
        return max(0, self._work_queue.qsize() - 1) if any(each.is_alive() for each in self.threads) else 0

    def _adjust_thread_count(self) -> None:
        """Start a thread if needed. Raises RuntimeError if the pool has no thread at all; then the call is dropped."""
        if not _has(self, POOL):
            super()._adjust_thread_count()  # which CPython has, if it calls this
            return
        this: Any = self
        if this._idle_semaphore.acquire(False) or len(this._threads) >= this._max_workers:
            return
        known, grow, begun_all = set(self.threads), super()._adjust_thread_count, []

        def run() -> None:
            with contextlib.suppress(RuntimeError):  # no thread can be started
                grow()
                begun_all.append(True)

        begin = threading.Thread(target=run, daemon=True)  # what it begins is so, too
        if start_thread(begin):
            begin.join()
        if not begun_all and not known:
            this._work_queue.get_nowait()
            raise RuntimeError(NO_THREAD)
        for thread in set(self.threads) - known:
            not_awaited(thread)
            self.begun(thread)


class Outside(Protocol):
    """Lets other code run during a wait."""

    def outside(self) -> AbstractContextManager[None]: ...

    def wait_for(self, function: Callable[[], T]) -> T: ...


class Condition(threading.Condition):
    def wait_outside(self, loop: Outside, timeout: float | None) -> bool:
        """Wait as in Python, but another thread than the one with the lock may do the waiting."""
        this: Any = self
        if not _has(self, CONDITION):
            return super().wait(timeout)
        if not this._is_owned():
            raise RuntimeError("cannot wait on un-acquired lock")
        called, is_called = threading.Lock(), False
        called.acquire()
        patience = -1 if timeout is None else max(0, timeout)
        this._waiters.append(called)
        state = this._release_save()
        try:
            with loop.outside():  # also while the lock is waited for
                try:
                    is_called = loop.wait_for(partial(called.acquire, True, patience))
                finally:
                    this._acquire_restore(state)
        finally:
            if not is_called and called in this._waiters:
                this._waiters.remove(called)
        return is_called


def release_all(lock: Any) -> Any:
    """Release an RLock completely. Returns what `retake` needs, which begins with the number of times it was taken."""
    if hasattr(lock, "_release_save"):
        return lock._release_save()
    lock.release()
    return (1,)


def retake(lock: Any, state: Any) -> None:
    if hasattr(lock, "_acquire_restore"):
        lock._acquire_restore(state)
    else:
        lock.acquire()


def use_condition(barrier: threading.Barrier, condition: threading.Condition) -> None:
    """Have a barrier wait by this condition."""
    if hasattr(barrier, "_cond"):
        barrier._cond = condition
