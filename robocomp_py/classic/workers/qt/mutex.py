"""Qt's mutexes. While code waits for one, the component's other handlers may run, so that there is no deadlock.

RoboComp's components run on several threads, and guard shared data by mutexes; here one thread runs at a time. A
handler that holds a mutex and waits for a reply lets other handlers run. If they want the same mutex, they leave the
monitor until it is free.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, ClassVar

from ....errors import Closed
from ....runtime.clock import SECOND, Clock

_LOOK_S = 1.0
"""Seconds between two checks, while waiting, whether the component ends."""

_STEP = SECOND // 1000
"""Nanoseconds between two attempts to lock on a clock that others move."""


class MutexSet:
    """Shared state of the mutexes of one component."""

    def __init__(
        self,
        outside: Callable[[], AbstractContextManager[None]],
        freed: Callable[[], object] = lambda: None,
        moved: Clock | None = None,
    ) -> None:
        """`freed` is called when the last locked mutex was released.

        `moved` is the component's clock if others move it. It must go on while code waits for a mutex, because the
        code that holds the mutex may wait for a time.
        """
        self.outside = outside
        self.closed = False
        self._freed, self._moved = freed, moved
        self._lock = threading.Lock()
        self._locked = 0

    @property
    def any_locked(self) -> bool:
        return self._locked > 0

    def wait(self, attempt: Callable[[float], bool], seconds: float) -> bool:
        """Attempt until it succeeds, or until that time has passed. An attempt takes the seconds that it may wait.

        Raises Closed if the component ends meanwhile.
        """
        with self.outside():
            if self._moved:
                return self._wait_on(self._moved, attempt, seconds)
            while not attempt(min(seconds, _LOOK_S)):
                seconds -= _LOOK_S
                if seconds <= 0:
                    return False
                self._check_open()
        return True

    def _wait_on(self, clock: Clock, attempt: Callable[[float], bool], seconds: float) -> bool:
        end = clock.now() + seconds * SECOND
        while not attempt(0):
            if clock.now() >= end:
                return False
            self._check_open()
            clock.wait(threading.Event(), clock.now() + _STEP)
        return True

    def _check_open(self) -> None:
        if self.closed:
            raise Closed("the component ends while it waits for a QMutex")

    def count(self, change: int) -> None:
        with self._lock:
            self._locked += change
            is_free = not self._locked
        if is_free:
            self._freed()


class Mutex:
    """`QMutex`, as PySide2 has it: `QMutex(QMutex.Recursive)` may be locked several times by the same thread."""

    NonRecursive, Recursive = 0, 1

    keeper: ClassVar[MutexSet]

    def __init__(self, mode: int = NonRecursive) -> None:
        self._recursive = mode == self.Recursive
        self._lock = threading.Lock()
        self._owner: int | None = None
        self._times = 0

    def isRecursive(self) -> bool:
        return self._recursive

    def lock(self) -> None:
        if self.try_lock(0):
            return
        if self._owner == threading.get_ident():
            raise RuntimeError(
                "this thread has locked this QMutex already, and it is not recursive: it would wait forever"
            )
        self.keeper.wait(self.try_lock, math.inf)

    def tryLock(self, timeout: int = 0) -> bool:
        """`timeout` in milliseconds; negative: as `lock`."""
        if timeout < 0:
            self.lock()
            return True
        if self.try_lock(0):
            return True
        if not timeout or self._owner == threading.get_ident():
            return False
        return self.keeper.wait(self.try_lock, timeout / 1000)

    def try_lock(self, seconds: float) -> bool:
        me = threading.get_ident()
        if self._recursive and self._owner == me:
            self._times += 1
            return True
        if not (self._lock.acquire(timeout=seconds) if seconds else self._lock.acquire(blocking=False)):
            return False
        self._owner, self._times = me, 1
        self.keeper.count(1)
        return True

    def unlock(self) -> None:
        if not self._times:
            raise RuntimeError("this QMutex is not locked")
        self._times -= 1
        if not self._times:
            self._owner = None
            self.keeper.count(-1)
            self._lock.release()


class RecursiveMutex(Mutex):
    """`QRecursiveMutex`, the name since Qt 6."""

    def __init__(self) -> None:
        super().__init__(self.Recursive)


class MutexLocker:
    """`QMutexLocker`: locks at once, unlocks at the end of a `with` or when it is deleted."""

    _locked = False

    def __init__(self, mutex: Mutex | None) -> None:
        self._mutex = mutex
        self.relock()

    def mutex(self) -> Mutex | None:
        return self._mutex

    def relock(self) -> None:
        if self._mutex and not self._locked:
            self._mutex.lock()
            self._locked = True

    def unlock(self) -> None:
        if self._mutex and self._locked:
            self._locked = False
            self._mutex.unlock()

    def __enter__(self) -> MutexLocker:
        return self

    def __exit__(self, *exc: Any) -> None:
        self.unlock()

    def __del__(self) -> None:
        self.unlock()


def mutexes(keeper: MutexSet) -> dict[str, type]:
    """The classes for one component, by their names in its files."""
    return {
        "QMutex": type("QMutex", (Mutex,), {"keeper": keeper}),
        "QRecursiveMutex": type("QRecursiveMutex", (RecursiveMutex,), {"keeper": keeper}),
        "QMutexLocker": type("QMutexLocker", (MutexLocker,), {}),
    }
