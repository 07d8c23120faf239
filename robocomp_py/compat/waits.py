"""What waits in Python's library, for one component: who waits there lets its handlers in, as at a call.

RoboComp runs handlers beside `compute`, and users guard what both use by locks, or have one wait for the other. Here
they take turns; so a wait has to be a turn's end, or a handler that wants a lock which is held by who waits for an
answer would keep both from going on.
"""

from __future__ import annotations

import concurrent.futures.thread
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from types import ModuleType, TracebackType
from typing import Any

Outside = Callable[[], AbstractContextManager[None]]
"""Around a wait: others are let in meanwhile."""

BELOW = ("concurrent.futures.thread", "concurrent.futures.process")
"""What is below these modules, and stays as it is."""


def modules(
    outside: Outside, locked: Callable[[int], None], begun: Callable[[threading.Thread], None]
) -> Mapping[str, ModuleType]:
    """The modules by name, with those of their parts that wait exchanged.

    `locked` is told of each lock that is taken (1) and given back (-1), `begun` of each thread that somebody would have
    to wait for at the end; the process does not.
    """
    futures = _like(concurrent.futures, **_futures(outside, begun))
    return {
        "threading": _like(threading, **_threading(outside, locked, begun)),
        "queue": _like(queue, **_queues(outside)),
        "time": _like(time, sleep=_sleeping(outside)),
        "concurrent": _like(concurrent, futures=futures),
        "concurrent.futures": futures,
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

        # by which a condition gives its lock away while it waits, however often it was taken, and takes it again

        def _release_save(self) -> Any:
            state = self._lock._release_save()
            locked(-state[0])
            return state

        def _acquire_restore(self, state: Any) -> None:
            self._lock._acquire_restore(state)
            locked(state[0])

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

    class Barrier(threading.Barrier):
        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **named)
            self._cond = Condition(Lock())  # so that all but the last wait outside, and its action runs inside

    def semaphore(base: type[threading.Semaphore]) -> type[threading.Semaphore]:
        class Waiting(base):  # type: ignore[misc, valid-type]  # one of two
            def acquire(self, blocking: bool = True, timeout: float | None = None) -> bool:
                if super().acquire(False):
                    return True
                if not blocking:
                    return False
                with outside():
                    return bool(super().acquire(True, timeout))

            __enter__ = acquire

        return _named(Waiting, base)

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
        "Barrier": Barrier,
        "Semaphore": semaphore(threading.Semaphore),
        "BoundedSemaphore": semaphore(threading.BoundedSemaphore),
        "Thread": Thread,
        "Timer": Timer,
    }


def _named(made: type[Any], base: type[Any]) -> type[Any]:
    made.__name__ = made.__qualname__ = base.__name__
    return made


def _queues(outside: Outside) -> dict[str, Any]:
    def waiting(base: type[Any]) -> type[Any]:
        class Waiting(base):  # type: ignore[misc]  # one of several
            def get(self, block: bool = True, timeout: float | None = None) -> Any:
                try:
                    return super().get(False)
                except queue.Empty:
                    if not block:
                        raise
                with outside():
                    return super().get(True, timeout)

            def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
                try:
                    super().put(item, False)
                except queue.Full:
                    if not block:
                        raise
                    with outside():
                        super().put(item, True, timeout)

            def join(self) -> None:
                with outside():
                    super().join()

        return _named(Waiting, base)

    every = (queue.Queue, queue.LifoQueue, queue.PriorityQueue, queue.SimpleQueue)
    return {base.__name__: waiting(base) for base in every}


def _futures(outside: Outside, begun: Callable[[threading.Thread], None]) -> dict[str, Any]:
    class Future(concurrent.futures.Future[Any]):
        def result(self, timeout: float | None = None) -> Any:
            with nullcontext() if self.done() else outside():
                return super().result(timeout)

        def exception(self, timeout: float | None = None) -> BaseException | None:
            with nullcontext() if self.done() else outside():
                return super().exception(timeout)

    class ThreadPoolExecutor(concurrent.futures.ThreadPoolExecutor):
        def submit(self, *arguments: Any, **named: Any) -> Future:
            future: Any = super().submit(*arguments, **named)
            future.__class__ = Future
            return future  # type: ignore[no-any-return]  # it is one now

        def _adjust_thread_count(self) -> None:
            """Begin a thread if need be, for which Python does not wait in the end: what it does may be endless."""
            known = set(self._threads)
            begin = threading.Thread(target=super()._adjust_thread_count, daemon=True)  # what it begins is so, too
            begin.start()
            begin.join()
            for thread in set(self._threads) - known:
                awaited: Any = concurrent.futures.thread._threads_queues  # those that Python waits for
                awaited.pop(thread, None)
                begun(thread)

        def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
            with outside() if wait else nullcontext():
                super().shutdown(wait, cancel_futures=cancel_futures)

    def wait(*arguments: Any, **named: Any) -> Any:
        with outside():
            return concurrent.futures.wait(*arguments, **named)

    def as_completed(*arguments: Any, **named: Any) -> Iterator[concurrent.futures.Future[Any]]:
        completed = concurrent.futures.as_completed(*arguments, **named)
        while True:
            with outside():
                future = next(completed, None)
            if future is None:
                return
            yield future

    made = (Future, ThreadPoolExecutor, wait, as_completed)
    return {each.__name__: each for each in made}
