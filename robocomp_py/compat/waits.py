"""`threading`, `queue` and `time` for one component: who waits in them lets its handlers in, as at a call.

RoboComp runs handlers beside `compute`, and users guard what both use by locks, or have one wait for the other. Here
they take turns; so a wait has to be a turn's end, or a handler that wants a lock which is held by who waits for an
answer would keep both from going on.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from types import ModuleType, TracebackType
from typing import Any

Outside = Callable[[], AbstractContextManager[None]]
"""Around a wait: others are let in meanwhile."""


def modules(
    outside: Outside, locked: Callable[[int], None], begun: Callable[[threading.Thread], None]
) -> Mapping[str, ModuleType]:
    """The modules by name, with those of their parts that wait exchanged.

    `locked` is told of each lock that is taken (1) and given back (-1), `begun` of each thread that somebody would have
    to wait for at the end; the process does not.
    """
    return {
        "threading": _like(threading, **_threading(outside, locked, begun)),
        "queue": _like(queue, **_queues(outside)),
        "time": _like(time, sleep=_sleeping(outside)),
    }


def _like(module: ModuleType, **instead: Any) -> ModuleType:
    made = ModuleType(module.__name__, module.__doc__)
    made.__dict__.update({**vars(module), **instead})
    return made


def _sleeping(outside: Outside) -> Callable[[float], None]:
    def sleep(seconds: float, /) -> None:
        with outside():
            time.sleep(seconds)

    return sleep


def _threading(
    outside: Outside, locked: Callable[[int], None], begun: Callable[[threading.Thread], None]
) -> dict[str, Any]:
    class Lock:
        """A lock that lets others in while it is waited for."""

        _make: Callable[[], Any] = staticmethod(threading.Lock)

        def __init__(self) -> None:
            self._lock = self._make()

        def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
            taken = bool(self._lock.acquire(False))
            if blocking and not taken:
                with outside():
                    taken = bool(self._lock.acquire(True, timeout))
            if taken:
                locked(1)
            return taken

        def release(self) -> None:
            self._lock.release()
            locked(-1)

        def __enter__(self) -> bool:
            return self.acquire()

        def __exit__(
            self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
        ) -> None:
            self.release()

        def __getattr__(self, name: str) -> Any:  # `locked`, and what conditions ask of a lock
            return getattr(self._lock, name)

    class RLock(Lock):
        _make = staticmethod(threading.RLock)

    class Condition(threading.Condition):
        def __init__(self, lock: Any = None) -> None:
            lock = RLock() if lock is None else lock
            super().__init__(lock)

        def wait(self, timeout: float | None = None) -> bool:
            with outside():
                return super().wait(timeout)

    class Event(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            if self.is_set():
                return True
            with outside():
                return super().wait(timeout)

    class Semaphore(threading.Semaphore):
        def acquire(self, blocking: bool = True, timeout: float | None = None) -> bool:
            if super().acquire(False):
                return True
            if not blocking:
                return False
            with outside():
                return super().acquire(True, timeout)

        __enter__ = acquire

    class BoundedSemaphore(threading.BoundedSemaphore):
        def acquire(self, blocking: bool = True, timeout: float | None = None) -> bool:
            if super().acquire(False):
                return True
            if not blocking:
                return False
            with outside():
                return super().acquire(True, timeout)

        __enter__ = acquire

    class Thread(threading.Thread):
        def start(self) -> None:
            is_awaited, self.daemon = not self.daemon, True
            super().start()
            if is_awaited:
                begun(self)

        def join(self, timeout: float | None = None) -> None:
            with outside():
                super().join(timeout)

    class Timer(Thread, threading.Timer):
        pass

    return {
        "Lock": Lock,
        "RLock": RLock,
        "Condition": Condition,
        "Event": Event,
        "Semaphore": Semaphore,
        "BoundedSemaphore": BoundedSemaphore,
        "Thread": Thread,
        "Timer": Timer,
    }


def _queues(outside: Outside) -> dict[str, Any]:
    def waiting(base: type[queue.Queue[Any]]) -> type[queue.Queue[Any]]:
        class Waiting(base):  # type: ignore[misc, valid-type]  # one of three
            def get(self, block: bool = True, timeout: float | None = None) -> Any:
                with outside():
                    return super().get(block, timeout)

            def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
                with outside():
                    super().put(item, block, timeout)

            def join(self) -> None:
                with outside():
                    super().join()

        Waiting.__name__ = Waiting.__qualname__ = base.__name__
        return Waiting

    return {base.__name__: waiting(base) for base in (queue.Queue, queue.LifoQueue, queue.PriorityQueue)}
