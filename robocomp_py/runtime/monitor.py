"""The lock of one worker: one thread runs user code at a time, and a thread that waits for a reply lets others in.

    inside       at most one thread: it runs compute, a handler, or a callback
    queued       threads and jobs that wait to enter, first come first served
    suspended    threads that were inside and wait for a reply; they enter again before queued ones

A job that cannot run at once is run by a pool of threads. Until the monitor is opened, jobs wait. If the system cannot
start another thread, a job stays in the queue until a thread of the pool is free, and waiting threads overtake it. If
the pool has no thread at all, the job is refused.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple, Protocol

from ..errors import Closed
from ..threads import Pool, start_thread
from ..transports.base import about_to_block
from .tally import Tallies

log = logging.getLogger("robocomp.worker")

Job = Callable[[], Any]
Then = Callable[[Any], object]
"""Called with the result of a job after the job has left the monitor."""

Refused = Callable[[], object]
"""Called instead of a queued job that will never run, because the monitor closes."""

MAX_SUSPENDED = 16
"""Maximum number of suspended handlers; further requests are answered with BUSY."""

CONCURRENT_THREADS = 16
MAX_CONCURRENT = 64
"""Maximum number of running and waiting calls of `concurrent` interfaces; further ones are answered with BUSY."""

MAX_WAITING = 1024
"""Maximum number of queued requests; further ones are answered with BUSY."""


class Workers(Protocol):
    """Runs each job on a thread; see `threads.Pool`."""

    def is_staffed(self) -> bool: ...

    def offer(self, job: Job, *, may_wait: bool = False) -> bool: ...

    def close(self) -> None: ...


class Pending(Protocol):
    """The future of a call that has no answer yet."""

    def turn_away(self) -> None:
        """End it with Closed."""


class Signal(Protocol):
    """Released by one thread, once; another one waits for that by `acquire`."""

    def acquire(self) -> bool: ...

    def release(self) -> None: ...


class Threads:
    """Where the jobs of a monitor run, and how its threads wait. In virtual time, an executor decides both."""

    def __init__(self, start: Callable[[threading.Thread], bool] = start_thread) -> None:
        """`start` starts a thread, and returns False if the system cannot."""
        self._start = start

    def pool(self, name: str, most: int, is_needed: Callable[[], bool], freed: Callable[[], object]) -> Workers:
        return Pool(name, most, is_needed=is_needed, freed=freed, start=self._start)

    def signal(self) -> Signal:
        lock = threading.Lock()
        lock.acquire()
        return lock

    def wait_for(self, future: Future[Any], timeout: float | None) -> None:
        """Wait until a future is done, at most `timeout` seconds."""
        with contextlib.suppress(TimeoutError, CancelledError):  # which the caller finds out
            Future.exception(future, timeout)


class _Ticket:
    """A thread's place in the queue. One that is `early` may enter before the monitor is opened."""

    def __init__(self, early: bool, called: Signal) -> None:
        self.thread = threading.get_ident()
        self.early = early
        self.refused = False
        self.called = called


class _Waiting(NamedTuple):
    """A job's place in the queue."""

    job: Job
    then: Then | None
    refused: Refused | None


class Monitor:
    """Safe to use from any thread. A thread must not enter twice, unless it is `suspended` in between.

    Methods on the path of every call use `acquire` and `release`, because `with` takes twice as long.
    """

    def __init__(self, name: str = "worker", threads: Threads | None = None) -> None:
        self.name = name
        self._threads = threads or Threads()
        self._state = threading.Lock()
        self._inside: int | None = None
        self._queue: deque[_Ticket | _Waiting] = deque()
        self._suspended = 0
        self._concurrent = 0
        self._open = False
        self._closed = False
        self._turns = 0
        """How often a thread has left or was suspended."""
        self._at_end: list[Callable[[], object]] = []
        self.pending: dict[Pending, None] = {}
        """Ended by `turn_away`. The code that ends one removes it first."""
        self.tallies = Tallies()
        """What is counted of the messages of the component."""
        self._pool = self._threads.pool(name, MAX_SUSPENDED + 8, lambda: bool(self._queue), self._freed)
        self._concurrent_pool = self._threads.pool(f"{name}-concurrent", CONCURRENT_THREADS, bool, bool)

    def open(self) -> None:
        """Admit jobs from now on."""
        with self._state:
            self._open = True
            if self._inside is None:
                self._admit_next()

    def close(self) -> None:
        """Refuse queued threads and jobs, and wait for running ones."""
        self.turn_away()
        self._concurrent_pool.close()
        self._pool.close()

    def at_end(self, callback: Callable[[], object]) -> None:
        """Call this, on any thread, whenever `turn_away` is called: it may be twice."""
        self._at_end.append(callback)

    def turn_away(self) -> None:
        """Refuse everything queued now or later, except suspended threads that return, and `early` ones.

        Calls that are pending end with Closed."""
        refused: list[Refused | None] = []
        with self._state:
            self._closed = True
            waiting, self._queue = self._queue, deque()
            for entry in waiting:
                if isinstance(entry, _Waiting):
                    refused.append(entry.refused)
                elif entry.early:
                    self._queue.append(entry)
                else:
                    entry.refused = True
                    entry.called.release()
        for each in (*refused, *self._at_end):
            _call_back(each)
        while self.pending:
            with contextlib.suppress(KeyError):  # the last one was answered meanwhile
                self.pending.popitem()[0].turn_away()

    @property
    def closed(self) -> bool:
        """Whether new threads and jobs are refused."""
        return self._closed

    @property
    def is_idle(self) -> bool:
        """Whether no thread is inside or queued, and no job."""
        with self._state:
            return self._inside is None and not self._queue

    @property
    def load(self) -> tuple[int, int]:
        """How many threads and jobs wait to enter, and how many threads are suspended."""
        with self._state:
            return len(self._queue), self._suspended

    @property
    def is_inside(self) -> bool:
        """Whether the calling thread is inside."""
        return self._inside == threading.get_ident()

    @contextmanager
    def held(self, *, early: bool = False) -> Iterator[None]:
        """Enter, run the block, and leave. `early`: even before the monitor is opened."""
        self.enter(early=early)
        try:
            yield
        finally:
            self.leave()

    def enter(self, *, early: bool = False) -> bool:
        """Wait until the calling thread may enter; returns whether it had to. Raises Closed if it never may."""
        with self._state:
            if self._closed and not early:
                raise Closed("the component is stopping")
            if self._inside is None and not self._queue and (self._open or early):
                self._inside = threading.get_ident()
                return False
            ticket = _Ticket(early, self._threads.signal())
            self._queue.append(ticket)
            if self._inside is None:
                self._admit_next()  # until the opening, jobs queued before this thread may have to stay
        about_to_block()
        ticket.called.acquire()
        if ticket.refused:
            raise Closed("the component is stopping")
        return True

    def try_enter(self) -> bool:
        """Enter at once, or return False: if a thread is inside or queued, or jobs are not admitted."""
        self._state.acquire()
        try:
            taken = self._inside is not None or self._queue or self._suspended >= MAX_SUSPENDED
            if taken or not self._open or self._closed:
                return False
            self._inside = threading.get_ident()
            return True
        finally:
            self._state.release()

    def turn(self) -> tuple[int | None, int]:
        """The thread inside, and the number of turns so far. If both are unchanged, it has been inside all the time."""
        return self._inside, self._turns

    def leave(self) -> None:
        self._state.acquire()
        try:
            self._turns += 1
            if self._queue:
                self._admit_next()
            else:
                self._inside = None
        finally:
            self._state.release()

    def submit(
        self, job: Job, then: Then | None = None, refused: Refused | None = None, *, limited: bool = True
    ) -> bool:
        """Run a job on the pool when it may enter.

        Returns False if too many jobs are waiting (only if `limited`), or if the pool cannot start a thread.
        """
        with self._state:
            if self._closed or (limited and (self._suspended >= MAX_SUSPENDED or len(self._queue) >= MAX_WAITING)):
                return False
            self._queue.append(_Waiting(job, then, refused))  # first: the pool keeps its threads while a job waits
            if not self._pool.is_staffed():
                self._queue.pop()
                return False
            if self._inside is None and self._open:
                self._admit_next()
            return True

    def submit_concurrent(self, job: Job, then: Then | None = None, refused: Refused | None = None) -> bool:
        """Run a job outside the monitor; False if there are too many already, or if the pool cannot start a thread."""
        with self._state:
            if self._closed or self._concurrent >= MAX_CONCURRENT:
                return False
            if not self._concurrent_pool.offer(partial(self._run_concurrent, job, then, refused), may_wait=True):
                return False
            self._concurrent += 1
        return True

    def run(self, job: Job) -> None:
        """Run a job on the calling thread if it can enter at once, otherwise by `submit` without limit.

        If the pool has no thread for the job, the calling thread waits and runs it.
        """
        if not self.try_enter():
            if self.submit(job, limited=False):
                return
            try:
                self.enter()
            except Closed:
                return  # the component is stopping
        try:
            job()
        finally:
            self.leave()

    def suspend(self) -> bool:
        """Before a wait: if the calling thread is inside, let others enter. Pass the result to `resume`."""
        if self._inside != threading.get_ident():
            return False
        self._state.acquire()
        try:
            self._suspended += 1
            self._turns += 1
            if self._queue:
                self._admit_next()
            else:
                self._inside = None
        finally:
            self._state.release()
        about_to_block()
        return True

    def resume(self, suspended: bool) -> None:
        """After a wait: enter again, before threads and jobs that have not begun."""
        if not suspended:
            return
        self._state.acquire()
        try:
            self._suspended -= 1
            if self._inside is None:
                self._inside = threading.get_ident()
                return
            ticket = _Ticket(early=True, called=self._threads.signal())
            self._queue.appendleft(ticket)
        finally:
            self._state.release()
        ticket.called.acquire()

    @contextmanager
    def suspended(self) -> Iterator[None]:
        """Suspend the calling thread around a wait, if it is inside."""
        out = self.suspend()
        try:
            yield
        finally:
            self.resume(out)

    def wait_for(self, future: Future[Any], timeout: float | None) -> None:
        """Wait until a future is done, at most `timeout` seconds, suspended."""
        with self.suspended():
            self._threads.wait_for(future, timeout)

    def _admit_next(self) -> None:
        """Admit the next thread or job, after the last one has left. Called with the state locked."""
        self._inside = None
        may_start = self._open
        for number, entry in enumerate(self._queue):
            if isinstance(entry, _Ticket):
                if not (self._open or entry.early):
                    continue
                self._inside = entry.thread
                entry.called.release()
            elif may_start and self._pool.offer(partial(self._run, entry.job, entry.then)):
                self._inside = _POOL
            else:
                may_start = False  # no thread for this job: `_freed` tries again
                continue
            del self._queue[number]
            return

    def _freed(self) -> None:
        """A thread of the pool is free: run a job that waits for one."""
        if self._queue and self._inside is None:
            with self._state:
                if self._inside is None:
                    self._admit_next()

    def _run(self, job: Job, then: Then | None) -> None:
        self._inside = threading.get_ident()
        try:
            result = job()
        except (Exception, SystemExit):
            log.exception("a handler failed")
            return
        finally:
            self.leave()
        if then:
            _call_back(partial(then, result))

    def _run_concurrent(self, job: Job, then: Then | None, refused: Refused | None) -> None:
        try:
            if self._closed:
                _call_back(refused)
            else:
                result = job()
                if then:
                    _call_back(partial(then, result))
        except (Exception, SystemExit):
            log.exception("a handler failed")
        finally:
            with self._state:
                self._concurrent -= 1


def _call_back(callback: Callable[[], object] | None) -> None:
    """Call a callback of a transport, and log what it raises: the thread has more jobs to run."""
    try:
        if callback:
            callback()
    except Exception:
        log.exception("a reply could not be passed to its transport")


_POOL = -1
"""Marks the monitor as entered for a job, until the pool's thread runs it."""
