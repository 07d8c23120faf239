"""One worker, one piece of user code at a time; who waits for an answer lets the others in.

    inside     at most one thread: compute, a handler, or a callback
    waiting    threads and jobs that want in, first come first served
    aside      threads that were inside and wait for an answer; they come back before the others

Jobs that cannot run at once are run by a pool of our own. Until the monitor is opened, jobs wait. If the system has no
thread to spare, a job stays in the queue until a thread of the pool is free, and threads that wait go before it. If the
pool has no thread at all, the job is turned away.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

from ..errors import Closed
from ..threads import Pool, start_thread
from ..transports.base import about_to_block

log = logging.getLogger("robocomp.worker")

Job = Callable[[], Any]
Then = Callable[[Any], object]
"""What is done with a job's result once it has left, when nobody need wait for that any more."""

Away = Callable[[], object]
"""What is done for a job that waited for its turn, if that will not come any more."""

MAX_ASIDE = 16
"""So many handlers may wait for answers; then new requests are turned away."""

THREADS_BESIDE = 16
MAX_BESIDE = 64
"""So many calls of `concurrent` interfaces may run or wait; then new ones are turned away."""

MAX_WAITING = 1024
"""So many requests may wait for their turn; then new ones are turned away."""


class Gauge:
    """How many requests were answered, and how long the slowest of them took. What is noted at once by several threads
    may be counted once."""

    def __init__(self) -> None:
        self._answered, self._slowest_s = 0, 0.0

    def note(self, seconds: float) -> None:
        self._answered += 1
        if seconds > self._slowest_s:
            self._slowest_s = seconds

    def take(self) -> tuple[int, float]:
        """Since this was called last."""
        taken = self._answered, self._slowest_s
        self._answered, self._slowest_s = 0, 0.0
        return taken


class _Ticket:
    """A thread's place in the queue. One that is `early` need not wait for the opening."""

    def __init__(self, early: bool) -> None:
        self.thread = threading.get_ident()
        self.early = early
        self.refused = False
        self.called = threading.Lock()
        self.called.acquire()


class _Waiting(NamedTuple):
    """A job's place in the queue."""

    job: Job
    then: Then | None
    away: Away | None


class Monitor:
    """Safe to use from any thread. A thread must not enter twice, except after `released`.

    Where every call passes, the lock is acquired and released: `with` takes twice as long.
    """

    def __init__(self, name: str = "worker", start: Callable[[threading.Thread], bool] = start_thread) -> None:
        """`start` starts a thread, and returns False if the system has none to spare."""
        self.name = name
        self._state = threading.Lock()
        self._inside: int | None = None
        self._queue: deque[_Ticket | _Waiting] = deque()
        self._aside = 0
        self._beside = 0
        self._open = False
        self._closed = False
        self._turns = 0
        """So often somebody who was inside has left, or has let others in."""
        self.gauge = Gauge()
        self._pool = Pool(name, MAX_ASIDE + 8, is_needed=lambda: bool(self._queue), freed=self._freed, start=start)
        self._pool_beside = Pool(f"{name}-beside", THREADS_BESIDE, start=start)

    def open(self) -> None:
        """Let jobs in from now on."""
        with self._state:
            self._open = True
            if self._inside is None:
                self._admit_next()

    def close(self) -> None:
        """Forget who waits, and wait for the jobs that run."""
        self.turn_away()
        self._pool_beside.close()
        self._pool.close()

    def turn_away(self) -> None:
        """Let in nobody any more but who comes back from a wait, or is `early`; who waits is sent away."""
        away: list[Away | None] = []
        with self._state:
            self._closed = True
            waiting, self._queue = self._queue, deque()
            for entry in waiting:
                if isinstance(entry, _Waiting):
                    away.append(entry.away)
                elif entry.early:
                    self._queue.append(entry)
                else:
                    entry.refused = True
                    entry.called.release()
        for each in away:
            _tell(each)

    @property
    def closed(self) -> bool:
        """Whether nobody new is let in any more."""
        return self._closed

    @property
    def mine(self) -> bool:
        """Whether the calling thread is inside."""
        return self._inside == threading.get_ident()

    @contextmanager
    def held(self, *, early: bool = False) -> Iterator[None]:
        """Inside, once it is our turn; `early` is for what comes before the opening."""
        self.enter(early=early)
        try:
            yield
        finally:
            self.leave()

    def enter(self, *, early: bool = False) -> None:
        """Wait until it is our turn. Raises Closed if it will never be."""
        with self._state:
            if self._closed and not early:
                raise Closed("the component ends")
            if self._inside is None and not self._queue and (self._open or early):
                self._inside = threading.get_ident()
                return
            ticket = _Ticket(early)
            self._queue.append(ticket)
            if self._inside is None:
                self._admit_next()  # before the opening, what waits in front of us may have to stay there
        about_to_block()
        ticket.called.acquire()
        if ticket.refused:
            raise Closed("the component ends")

    def try_enter(self) -> bool:
        """Go inside if nobody is, and nobody waits, and jobs are let in."""
        self._state.acquire()
        try:
            taken = self._inside is not None or self._queue or self._aside >= MAX_ASIDE
            if taken or not self._open or self._closed:
                return False
            self._inside = threading.get_ident()
            return True
        finally:
            self._state.release()

    def turn(self) -> tuple[int | None, int]:
        """Who is inside, and for the how manieth turn: if both are as before, that one has been at it all the time."""
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

    def submit(self, job: Job, then: Then | None = None, away: Away | None = None, *, limited: bool = True) -> bool:
        """Run a job on the pool when it is its turn.

        Returns False if too many jobs wait already, unless not `limited`, or if the pool cannot have a thread.
        """
        with self._state:
            if self._closed or (limited and (self._aside >= MAX_ASIDE or len(self._queue) >= MAX_WAITING)):
                return False
            self._queue.append(_Waiting(job, then, away))  # first, because the pool keeps its threads while a job waits
            if not self._pool.is_staffed():
                self._queue.pop()
                return False
            if self._inside is None and self._open:
                self._admit_next()
            return True

    def submit_beside(self, job: Job, then: Then | None = None, away: Away | None = None) -> bool:
        """Run a job on the pool beside others; False if too many do already, or if the pool cannot have a thread."""
        with self._state:
            if self._closed or self._beside >= MAX_BESIDE:
                return False
            if not self._pool_beside.offer(partial(self._run_beside, job, then, away), may_wait=True):
                return False
            self._beside += 1
        return True

    def run(self, job: Job) -> None:
        """Run a job here and now if no thread is inside, else by `submit`, without limit.

        If there is no thread for it, the calling thread waits for its turn.
        """
        if not self.try_enter():
            if self.submit(job, limited=False):
                return
            try:
                self.enter()
            except Closed:
                return  # the component ends: nothing of it is called any more
        try:
            job()
        finally:
            self.leave()

    def step_out(self) -> bool:
        """Before a wait: if the calling thread is inside, let the others in. Pass the result to `step_in`."""
        if self._inside != threading.get_ident():
            return False
        self._state.acquire()
        try:
            self._aside += 1
            self._turns += 1
            if self._queue:
                self._admit_next()
            else:
                self._inside = None
        finally:
            self._state.release()
        about_to_block()
        return True

    def step_in(self, stepped_out: bool) -> None:
        """After a wait: back inside, ahead of those who have not begun."""
        if not stepped_out:
            return
        self._state.acquire()
        try:
            self._aside -= 1
            if self._inside is None:
                self._inside = threading.get_ident()
                return
            ticket = _Ticket(early=True)
            self._queue.appendleft(ticket)
        finally:
            self._state.release()
        ticket.called.acquire()

    @contextmanager
    def released(self) -> Iterator[None]:
        """Around a wait: `step_out` and `step_in`."""
        out = self.step_out()
        try:
            yield
        finally:
            self.step_in(out)

    def _admit_next(self) -> None:
        """Nobody is inside any more: let the next one in. Called with the state locked."""
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
        """A thread of the pool is free: run a job for which there was none."""
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
            _tell(partial(then, result))

    def _run_beside(self, job: Job, then: Then | None, away: Away | None) -> None:
        try:
            if self._closed:
                _tell(away)
            else:
                result = job()
                if then:
                    _tell(partial(then, result))
        except (Exception, SystemExit):
            log.exception("a handler failed")
        finally:
            with self._state:
                self._beside -= 1


def _tell(what: Callable[[], object] | None) -> None:
    """Pass an answer on to who waits for it, if anybody does."""
    try:
        if what:
            what()
    except Exception:  # that of one transport; the thread has other jobs, and other components end by it
        log.exception("an answer was not passed on")


_POOL = -1
"""Stands for the pool's thread that will be inside as soon as it runs."""
