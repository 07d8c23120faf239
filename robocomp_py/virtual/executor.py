"""Runs events one after the other, and moves the clock from one to the next.

    soon     what is to be done at the present instant, in the order in which it was asked for
    later    what is due at a later instant: ordered by time, then by component, then by age

User code may wait in the middle of an event (`sleep`, a call whose handler sleeps). Waits need not end in the order in
which they began. So each waiting event keeps its thread, and another thread goes on with the next event. Only one of
all these threads runs at any time, so the order of events depends on nothing but the components.
"""

from __future__ import annotations

import heapq
import itertools
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

from ..errors import Closed, ComponentError
from ..threads import NO_THREAD, start_thread
from .interrupts import Interrupts

Job = Callable[[], object]

LAST = math.inf
"""The order of what belongs to no component: it comes after all that is due at the same instant."""


_FIRST_LOOK = 0.05
_SHORT = 0.001
"""Seconds until `look` is called for the first time, and the least to wait for a call that is due."""


class Stepped(Protocol):
    """Something with events of its own, such as a component with its timers."""

    def due(self) -> int | None:
        """The instant of its next event, in ns: the present one if it is late, and None if it has none.

        If a step of it waits, this is asked meanwhile.
        """
        ...

    def step(self) -> None:
        """Run the event that is due."""
        ...


class Pause:
    """The wait of a thread in the middle of an event: for `end`, for an instant, or for a condition."""

    def __init__(self, executor: Executor, condition: Callable[[], bool] = bool) -> None:
        self._executor, self.condition = executor, condition
        self.turn = threading.Lock()
        """Released when the thread goes on."""
        self.turn.acquire()
        self.over = False
        self.ended = False
        """Whether `end` was called in time."""

    def end(self) -> None:
        """Let the thread go on at the present instant. Without effect if its wait is over."""
        if not self.over:
            self.over = self.ended = True
            self._executor.do(self)

    def wait(self, until: int | None = None, order: float = LAST) -> bool:
        """Wait for `end` or the condition, or until an instant. Returns False if the instant came first.

        Other events happen meanwhile. Of several waits until the same instant, the one of the lowest `order` ends
        first. Raises Closed if the executor is closed, and ComponentError on a thread that a component started.
        """
        self._executor.wait(self, until, order)
        return self.ended

    def expire(self) -> None:
        """Let the thread go on because its instant has come. Without effect if its wait is over."""
        if not self.over:
            self.over = True
            self._executor.do(self)


class Executor:
    """Safe to use only from its events, and from the thread that calls `run`, while `run` is not running."""

    def __init__(self, look: Callable[[threading.Thread], float] = lambda thread: math.inf) -> None:
        """`look` is called from time to time while `run` waits for the thread that runs an event, with that thread.

        It returns the seconds until the next call.
        """
        self.now = 0
        """The present instant, in ns."""
        self.events = 0
        """Number of events so far."""
        self.closed = False
        self._soon: deque[Job | Pause] = deque()
        self._later: list[tuple[int, float, int, Job]] = []
        self._ages = itertools.count()
        self._stepped: list[Stepped] = []
        self._stepping: list[Stepped] = []
        """Those in the middle of a step."""
        self._until: Callable[[], object] = bool
        self._end = 0
        self._idle: list[threading.Lock] = []
        """What lets the threads without an event go on."""
        self._waiting: list[Pause] = []
        self._threads: list[threading.Thread] = []
        self._running = 0
        """The one thread that runs events now; 0 if `run` is not running."""
        self._returned, self._has_returned = threading.Lock(), False
        """Released when `run` goes on, and whether that has happened. A new lock for each `run`."""
        self._failure: BaseException | None = None
        self._is_stuck = False
        self._interrupts = Interrupts(self._stop_early)
        self._look, self._looks_at = look, time.monotonic() + _FIRST_LOOK
        """The function, and when to call it next, in seconds of the machine."""

    @property
    def stepping(self) -> Sequence[Stepped]:
        """Those in the middle of a step, the latest last."""
        return self._stepping

    @property
    def threads(self) -> Sequence[threading.Thread]:
        """The threads that run events."""
        return self._threads

    def add(self, stepped: Stepped) -> None:
        """Add something with events. Of two that are due at the same instant, the one added first comes first."""
        self._stepped.append(stepped)

    def run(self, until: Callable[[], object], end: int) -> bool:
        """Run events until a condition holds, or until the instant `end`; returns whether the condition holds.

        The condition is looked at before each event. Events at `end` itself are run. Raises what an event raises.
        """
        while self._is_interrupted(until, end) and not self._failure:
            pass  # the handler of the signal raised nothing, so go on
        if self._failure:
            failure, self._failure = self._failure, None
            raise failure
        return bool(until())

    def _is_interrupted(self, until: Callable[[], object], end: int) -> bool:
        """Run events as `run` does, but a signal makes the event that runs the last one; returns whether one came."""
        self._until, self._end = until, end
        with self._interrupts as signals:
            self._expect_return()
            self._next_thread()
            try:
                while not self._returned.acquire(timeout=self._until_look()):
                    for thread in [each for each in self._threads if each.ident == self._running]:
                        self._looks_at = time.monotonic() + self._look(thread)
            except BaseException:  # of a second signal, or of one that is not deferred, such as SIGALRM
                self._stop_early()
                self._is_stuck = True
                while not signals.received and not self._has_returned:  # the lock may have been taken just before
                    self._returned.acquire(timeout=_FIRST_LOOK)
                self._is_stuck = not self._has_returned
                raise
            finally:
                self._running = 0
        return bool(signals.received)

    def _stop_early(self) -> None:
        self._until = lambda: True

    def _expect_return(self) -> None:
        self._returned, self._has_returned = threading.Lock(), False
        self._returned.acquire()

    def _until_look(self) -> float:
        return min(max(_SHORT, self._looks_at - time.monotonic()), threading.TIMEOUT_MAX)

    def run_next(self, end: int) -> bool:
        """Run the next event, if there is one until the instant `end`; returns whether there was one."""
        events = self.events
        return self.run(lambda: self.events > events, end)

    def close(self) -> None:
        """End all threads, unless one is stuck in user code. Where that waits, `wait` raises Closed. Idempotent."""
        self.closed = True
        self._interrupts.close()
        if self._is_stuck:
            return  # threads that still run end with the process
        while self._waiting or self._idle:
            self._expect_return()
            turn = self._waiting.pop().turn if self._waiting else self._idle.pop()
            turn.release()
            self._returned.acquire()  # one after the other
        for thread in self._threads:
            thread.join()
        self._threads.clear()

    def do(self, job: Job | Pause) -> None:
        """Do something at the present instant, after all that was asked for before."""
        self._soon.append(job)

    def at(self, instant: int, job: Job, order: float = LAST) -> None:
        """Do something at an instant (ns)."""
        heapq.heappush(self._later, (instant, order, next(self._ages), job))

    @property
    def in_own_thread(self) -> bool:
        """Whether the calling thread runs an event."""
        return self._running == threading.get_ident()

    def check_thread(self) -> None:
        """Raise ComponentError on a thread that a component started."""
        if not self.in_own_thread:
            raise ComponentError(
                f"the thread `{threading.current_thread().name}` is not part of the simulation: in virtual time, "
                "components call others, publish and wait only in methods that the framework calls"
            )

    def wait(self, pause: Pause, until: int | None, order: float) -> None:
        """See `Pause.wait`."""
        self.check_thread()
        if self.closed:
            raise Closed("the simulation has ended")
        if pause.ended:  # before the wait began
            self._soon.remove(pause)
            return
        if pause.condition():
            pause.over = pause.ended = True
            return
        if until is not None:
            self.at(until, pause.expire, order)
        self._waiting.append(pause)
        try:
            self._next_thread()
        except ComponentError:
            pause.over = True
            self._waiting.remove(pause)
            raise
        pause.turn.acquire()
        self._running = threading.get_ident()
        if self.closed:
            raise Closed("the simulation has ended")
        self._waiting.remove(pause)

    def _next_thread(self) -> None:
        """Let another thread run events. The calling one must wait then."""
        if self._idle:
            self._idle.pop().release()
            return
        thread = threading.Thread(target=self._serve, name=f"simulation-{len(self._threads)}", daemon=True)
        self._threads.append(thread)
        if not start_thread(thread):
            self._threads.pop()
            raise ComponentError(f"the simulation cannot go on: {NO_THREAD}")

    def _serve(self) -> None:
        """Run events until another thread is to go on, then wait for the next turn."""
        mine = threading.Lock()
        mine.acquire()
        while True:
            self._running = threading.get_ident()
            goes_on = self._run_events()
            if self.closed:
                self._returned.release()
                return
            self._idle.append(mine)
            self._has_returned = goes_on is self._returned
            goes_on.release()
            mine.acquire()
            if self.closed:
                self._returned.release()
                return

    def _run_events(self) -> threading.Lock:
        """Returns what lets the thread go on whose turn it is."""
        try:
            while not self.closed and not self._until():
                event = self._next()
                if event is None:
                    break
                self.events += 1
                if isinstance(event, Pause):
                    return event.turn
                event()
        except BaseException as exc:  # `run` raises it
            if not self.closed:
                self._failure = exc
        return self._returned

    def _next(self) -> Job | Pause | None:
        """The next event, to which the clock is moved; None if there is none until the end."""
        for pause in self._waiting:
            if pause.condition():
                pause.end()
        if self._soon:
            return self._soon.popleft()
        first, number = self._first_step()
        is_later = bool(self._later) and (first is None or self._later[0][:2] <= (first, number))
        instant = self._later[0][0] if is_later else first
        if instant is None:
            return None
        if instant > self._end:
            self.now = max(self.now, self._end)
            return None
        self.now = max(self.now, instant)
        return heapq.heappop(self._later)[3] if is_later else partial(self._step, self._stepped[number])

    def _first_step(self) -> tuple[int | None, int]:
        """The instant of the first step that is due, and the number of what takes it."""
        first, number = None, 0
        for each, stepped in enumerate(self._stepped):
            instant = stepped.due()
            if instant is not None and (first is None or instant < first):
                first, number = instant, each
                if first <= self.now:
                    break  # no other one is earlier
        return first, number

    def _step(self, stepped: Stepped) -> None:
        self._stepping.append(stepped)
        try:
            stepped.step()
        finally:
            self._stepping.remove(stepped)
