"""What components need of an executor: a clock, and threads that take turns."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from ..runtime.clock import NEVER, ns
from ..runtime.monitor import Signal, Threads, Workers
from ..threads import Job
from .executor import Executor, Pause


class TurnClock:
    """The clock of one component; see `runtime.clock.Clock`. It stands still while an event runs."""

    def __init__(self, executor: Executor, order: int = 0) -> None:
        self._executor, self._order = executor, order

    def now(self) -> int:
        return self._executor.now

    reached = now

    def wait(self, wake: threading.Event, until: int) -> bool:
        Pause(self._executor, wake.is_set).wait(None if until == NEVER else until, self._order)
        return wake.is_set()


class TurnThreads(Threads):
    """The threads of the executor, which take turns."""

    def __init__(self, executor: Executor) -> None:
        super().__init__()
        self._executor = executor

    def pool(self, name: str, most: int, is_needed: Callable[[], bool], freed: Callable[[], object]) -> Workers:
        return _Events(self._executor)

    def signal(self) -> Signal:
        return _Signal(self._executor)

    def wait_for(self, future: Future[Any], timeout: float | None) -> None:
        pause = Pause(self._executor)
        Future.add_done_callback(future, lambda _: pause.end())  # also if the component runs no callbacks any more
        pause.wait(None if timeout is None else self._executor.now + ns(timeout))


class _Events:
    """A pool without threads: each job is an event."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def is_staffed(self) -> bool:
        return True

    def offer(self, job: Job, *, may_wait: bool = False) -> bool:
        self._executor.do(job)
        return True

    def close(self) -> None: ...


class _Signal:
    """A lock that is taken once, after another thread has released it."""

    def __init__(self, executor: Executor) -> None:
        self._pause = Pause(executor)

    def acquire(self) -> bool:
        return self._pause.wait()

    def release(self) -> None:
        self._pause.end()
