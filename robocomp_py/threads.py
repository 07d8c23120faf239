"""Threads where the system may have none to spare: RLIMIT_NPROC, the limit of a container, or memory is reached."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import Empty, SimpleQueue
from typing import TypeVar

log = logging.getLogger("robocomp.worker")

T = TypeVar("T")

Job = Callable[[], object]

NO_THREAD = "no thread can be started; raise the limit of processes (`ulimit -u`, or that of the container)"

_IDLE = 5.0
"""Seconds after which an idle thread of a pool ends."""


def start_thread(thread: threading.Thread) -> bool:
    """Start a thread; False if the system has none to spare. It may be called again for another thread."""
    try:
        thread.start()
    except RuntimeError:
        if thread.ident is not None:  # it was started before, which is a mistake of the caller
            raise
        return False
    return True


def only_wakes_a_loop(callback: Callable[..., object]) -> bool:
    """Whether this is asyncio's own callback of a future, by `wrap_future`: it tells an event loop that the future is
    done, and runs no code of a user. So it may be called on any thread at any time, also when a component stops."""
    return getattr(callback, "__module__", "") == "asyncio.futures"


def fulfil(future: Future[T], function: Callable[[], T]) -> None:
    """Call a function, and pass on what it returns or raises."""
    try:
        result = function()
    except BaseException as exc:  # it is raised where the future is waited for
        future.set_exception(exc)
    else:
        future.set_result(result)


class Pool:
    """Runs each job on an idle thread, or else on a new one, up to `most` threads.

    Unlike the executor of the standard library, it takes a job only if a thread of its own will run it: a job that
    raises an error here is not run later. `is_needed` keeps an idle thread from ending. `freed` is called on a thread
    that has finished a job.
    """

    def __init__(
        self,
        name: str,
        most: int,
        *,
        is_needed: Callable[[], bool] = lambda: False,
        freed: Callable[[], object] = lambda: None,
        start: Callable[[threading.Thread], bool] = start_thread,
    ) -> None:
        self._name, self._most, self._is_needed, self._freed, self._start = name, most, is_needed, freed, start
        self._lock = threading.Lock()
        self._jobs: SimpleQueue[Job | None] = SimpleQueue()
        self._threads: list[threading.Thread] = []
        self._free = 0
        """Idle threads, less the jobs that wait for one."""
        self._count = 0
        self._closed = False

    def is_staffed(self) -> bool:
        """Whether there is a thread, busy or not; the first one is started by this."""
        with self._lock:
            return bool(self._threads) or self._grow()

    def offer(self, job: Job, *, may_wait: bool = False) -> bool:
        """Run a job. Returns False, without running it, if no thread is free and none can be started.

        With `may_wait`, a job waits for a busy thread, and only a pool without any thread refuses it.
        """
        with self._lock:
            if self._closed:
                return False
            if self._free <= 0 and not self._grow() and not (may_wait and self._threads):
                return False
            self._free -= 1
            self._jobs.put(job)
            return True

    def close(self, *, wait: bool = True) -> None:
        """Run the jobs that were taken, then end all threads, and `wait` for them, except for the calling one."""
        with self._lock:
            self._closed = True
            threads = list(self._threads)
            for _ in threads:
                self._jobs.put(None)
        for thread in threads:
            if wait and thread is not threading.current_thread():
                thread.join()

    def _grow(self) -> bool:
        """With the lock."""
        if self._closed or len(self._threads) >= self._most:
            return False
        thread = threading.Thread(target=self._work, name=f"{self._name}_{self._count}")
        if not self._start(thread):
            return False
        self._count += 1
        self._threads.append(thread)
        self._free += 1
        return True

    def _work(self) -> None:
        while True:
            try:
                job = self._jobs.get(timeout=_IDLE)
            except Empty:
                if self._may_end():
                    return
                continue
            if job is None:
                return
            try:
                job()
            except BaseException:  # also SystemExit, which would end this thread, and nothing else
                log.exception("%s: a job failed", self._name)
            del job  # or what it holds would live until the next one
            with self._lock:
                self._free += 1
            self._freed()

    def _may_end(self) -> bool:
        with self._lock:
            if self._free <= 0 or self._closed or self._is_needed():
                return False
            self._free -= 1
            self._threads.remove(threading.current_thread())
            return True
