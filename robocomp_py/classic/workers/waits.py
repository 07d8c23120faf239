"""Replaces blocking functions of Python's library in one component: while they wait, its handlers may run.

RoboComp runs handlers in parallel with `compute`, so components use locks, and let one wait for the other. Here, code
of a component runs one piece at a time. So a blocking function has to let others run, as a call does. Otherwise a
handler that waits for a lock, and the code that holds the lock and waits for a reply, would block each other.

    a lock           lets handlers run only if it has to wait
    anything else    lets handlers run each time: code that reads a queue that is never empty would never wait, and
                     would keep them from running
"""

from __future__ import annotations

import concurrent.futures
import queue
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from functools import partial
from types import ModuleType, TracebackType
from typing import Any, Protocol, TypeVar
from weakref import WeakSet

from . import unsafe
from .unsafe import Pool

T = TypeVar("T")

BELOW = ("concurrent.futures.thread", "concurrent.futures.process")
"""Modules that these are built on; they are not replaced."""


class Loop(Protocol):
    """Lets the component's other code run during a wait."""

    def outside(self) -> AbstractContextManager[None]:
        """Entered around a wait for a lock, which must happen on the thread that takes it."""

    def wait_for(self, function: Callable[[], T]) -> T:
        """Call a blocking function, on any thread, while other code may run."""

    def locked(self, change: int) -> None:
        """A lock was taken (1) or released (-1). Meanwhile, code that may want it must not run on this thread."""


class Begun:
    """Threads and pools that a component has started. In RoboComp they keep the process from ending; here not."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._threads: list[threading.Thread] = []
        self._pools: WeakSet[Pool] = WeakSet()

    def thread(self, thread: threading.Thread) -> None:
        with self._lock:
            self._threads = [*(each for each in self._threads if each.is_alive()), thread]

    def pool(self, pool: Pool) -> None:
        with self._lock:
            self._pools.add(pool)

    def pools(self) -> list[Pool]:
        """The pools that are still referenced."""
        with self._lock:
            return list(self._pools)

    def end(self, pools: Collection[Pool], grace_s: float, work_s: float) -> tuple[list[str], int]:
        """Shut down the pools, and wait for threads: at most `grace_s`, or `work_s` for pools with waiting calls.

        Returns the names of threads that still run, and the number of calls that still wait."""
        begun = time.monotonic()
        for pool in pools:
            if not pool.ended:
                pool.shutdown(wait=False)
        _join(self._threads, begun + grace_s)
        _join([thread for pool in pools if pool.waiting for thread in pool.threads], begun + work_s)
        return [each.name for each in self._threads if each.is_alive()], sum(pool.waiting for pool in pools)


def _join(threads: Iterable[threading.Thread], end: float) -> None:
    for thread in threads:
        thread.join(max(0.0, end - time.monotonic()))


def modules(loop: Loop, begun: Begun) -> Mapping[str, ModuleType]:
    """The modules by name, with their blocking functions replaced."""
    futures = _like(concurrent.futures, **_futures(loop, begun))
    return {
        "threading": _like(threading, **_locks(loop), **_threads(loop, begun)),
        "queue": _like(queue, **_queues(loop)),
        "time": _like(time, sleep=_sleeping(loop)),
        "concurrent": _like(concurrent, futures=futures),
        "concurrent.futures": futures,
    }


def _like(module: ModuleType, **instead: Any) -> ModuleType:
    made = ModuleType(module.__name__, module.__doc__)
    made.__dict__.update({**vars(module), **instead})
    return made


def _sleeping(loop: Loop) -> Callable[[float], None]:
    def sleep(seconds: float, /) -> None:
        loop.wait_for(partial(time.sleep, seconds))

    return sleep


def _locks(loop: Loop) -> dict[str, Any]:
    """The classes of `threading` that one waits for."""
    locked = loop.locked

    class Lock:
        """A lock that lets other code run while it is waited for."""

        _make: Callable[[], Any] = staticmethod(threading.Lock)

        def __init__(self) -> None:
            self._lock = self._make()

        def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
            taken = bool(self._lock.acquire(False))
            if blocking and not taken:
                with loop.outside():
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

        # A condition uses these to release its lock completely during a wait, and to take it again.

        def _release_save(self) -> Any:
            state = unsafe.release_all(self._lock)
            locked(-state[0])
            return state

        def _acquire_restore(self, state: Any) -> None:
            unsafe.retake(self._lock, state)
            locked(state[0])

    class Condition(unsafe.Condition):
        def __init__(self, lock: Any = None) -> None:
            lock = RLock() if lock is None else lock
            super().__init__(lock)

        def wait(self, timeout: float | None = None) -> bool:
            return self.wait_outside(loop, timeout)

    class Event(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            return loop.wait_for(partial(super().wait, timeout))

    class Barrier(threading.Barrier):
        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **named)
            unsafe.use_condition(self, Condition(Lock()))  # all but the last wait outside; its action runs inside

    def semaphore(base: type[threading.Semaphore]) -> type[threading.Semaphore]:
        class Waiting(base):  # type: ignore[misc, valid-type]  # one of two
            def acquire(self, blocking: bool = True, timeout: float | None = None) -> bool:
                if not blocking:
                    return bool(super().acquire(False, timeout))
                return bool(loop.wait_for(partial(super().acquire, True, timeout)))

            # around something it is a lock, whatever it counts

            def __enter__(self) -> bool:
                if not super().acquire(False):  # as a lock, it lets others in only if it is taken
                    self.acquire()
                locked(1)
                return True

            def __exit__(self, *exc: Any) -> None:
                locked(-1)
                self.release()

        return _named(Waiting, base)

    return {
        "Lock": Lock,
        "RLock": RLock,
        "Condition": Condition,
        "Event": Event,
        "Barrier": Barrier,
        "Semaphore": semaphore(threading.Semaphore),
        "BoundedSemaphore": semaphore(threading.BoundedSemaphore),
    }


def _threads(loop: Loop, begun: Begun) -> dict[str, Any]:
    class Thread(threading.Thread):
        def start(self) -> None:
            is_awaited, self.daemon = not self.daemon, True
            try:
                super().start()
            except RuntimeError:
                if self.ident is None:  # no thread can be started now; one that is started later is awaited, too
                    self.daemon = not is_awaited
                raise
            if is_awaited:
                begun.thread(self)

        def join(self, timeout: float | None = None) -> None:
            loop.wait_for(partial(super().join, timeout))

    class Timer(Thread, threading.Timer):
        pass

    return {"Thread": Thread, "Timer": Timer}


def _named(made: type[Any], base: type[Any]) -> type[Any]:
    made.__name__ = made.__qualname__ = base.__name__
    return made


def _queues(loop: Loop) -> dict[str, Any]:
    def waiting(base: type[Any]) -> type[Any]:
        class Waiting(base):  # type: ignore[misc]  # one of several
            def get(self, block: bool = True, timeout: float | None = None) -> Any:
                get = partial(super().get, block, timeout)
                return loop.wait_for(get) if block else get()

            def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
                put = partial(super().put, item, block, timeout)
                if block:
                    loop.wait_for(put)
                else:
                    put()

            def join(self) -> None:
                loop.wait_for(super().join)

        return _named(Waiting, base)

    every = (queue.Queue, queue.LifoQueue, queue.PriorityQueue, queue.SimpleQueue)
    return {base.__name__: waiting(base) for base in every}


def _futures(loop: Loop, begun: Begun) -> dict[str, Any]:
    class Future(concurrent.futures.Future[Any]):
        def result(self, timeout: float | None = None) -> Any:
            return loop.wait_for(partial(super().result, timeout))

        def exception(self, timeout: float | None = None) -> BaseException | None:
            return loop.wait_for(partial(super().exception, timeout))

    class ThreadPoolExecutor(Pool):
        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **named)
            self.begun = begun.thread  # type: ignore[method-assign]
            begun.pool(self)

        def submit(self, *arguments: Any, **named: Any) -> Future:
            future: Any = super().submit(*arguments, **named)
            future.__class__ = Future
            return future  # type: ignore[no-any-return]  # it is one now

        def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
            end = partial(super().shutdown, wait, cancel_futures=cancel_futures)
            if wait:
                loop.wait_for(end)
            else:
                end()

    def wait(*arguments: Any, **named: Any) -> Any:
        return loop.wait_for(partial(concurrent.futures.wait, *arguments, **named))

    def as_completed(*arguments: Any, **named: Any) -> Iterator[concurrent.futures.Future[Any]]:
        completed = concurrent.futures.as_completed(*arguments, **named)
        while (future := loop.wait_for(partial(next, completed, None))) is not None:
            yield future

    made = (Future, ThreadPoolExecutor, wait, as_completed)
    return {each.__name__: each for each in made}
