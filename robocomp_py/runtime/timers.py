"""The timers of a component: those that its CDSL declares, and those that its code starts by `after`.

    due       the time at which the first of them is due, of those that are not running
    take      that one, if it is due
    run       calls it, inside the monitor of the component
    begin     does both, by a thread of its own and those of the monitor; without it, an executor does

The thread starts with the first timer: a component without timers has none.

`compute` is the `Timer` that every component has, but the thread of the component calls it.
"""

from __future__ import annotations

import heapq
import inspect
import itertools
import threading
from collections.abc import Callable, Iterable, Iterator

from ..contract.component import MAX_SECONDS
from ..errors import ComponentError
from ..spelling import unknown
from ..threads import NO_THREAD, start_thread
from .clock import NEVER, SECOND, Clock, ns
from .lifecycle import Beat

MAX_PENDING = 1000
"""Maximum number of functions that wait for their time."""

_STUCK = 5.0
"""Seconds that closing waits for the thread."""


class Timer:
    """A method that is called every period, as `self.timers.poll` in user code.

    Calls never overlap. Periods that pass during a call are skipped and counted.
    """

    def __init__(
        self, name: str, beat: Beat, wake: Callable[[], None], method: Callable[[], object] = lambda: None
    ) -> None:
        """`wake` is called when it may be due earlier."""
        self.name = name
        self._method = method
        self.calls = 0
        """How often its method was called."""
        self._beat, self._wake = beat, wake
        self._is_running = False
        self._was_slow = False

    @property
    def period(self) -> float:
        """Seconds from one call to the next. May be set at any time, and then holds from the last call on."""
        return self._beat.period

    @period.setter
    def period(self, seconds: float) -> None:
        if not 0 < seconds <= MAX_SECONDS:
            raise ValueError(f"a period is a positive number of seconds, at most {MAX_SECONDS:g}, not {seconds!r}")
        self._beat.period = seconds
        self._wake()

    @property
    def overruns(self) -> int:
        """Number of periods skipped because a call took too long."""
        return self._beat.overruns

    def __repr__(self) -> str:
        return f"<timer {self.name}: every {self.period:g} s, {self.calls} calls, {self.overruns} overruns>"


class Timers:
    """The timers that a component declares, by name: `self.timers.poll`."""

    def __init__(self, timers: Iterable[Timer] = ()) -> None:
        self._timers = {each.name: each for each in timers}

    def __getattr__(self, name: str) -> Timer:
        if name.startswith("__"):
            raise AttributeError(name)
        try:
            return self._timers[name]
        except KeyError:
            raise AttributeError(unknown("timer", name, self._timers)) from None

    def __setattr__(self, name: str, value: object) -> None:
        if name != "_timers":
            raise AttributeError(f"timers cannot be replaced; to change one: self.timers.{name}.period = 0.1")
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted(self._timers)

    def __iter__(self) -> Iterator[Timer]:
        return iter(self._timers.values())

    def __len__(self) -> int:
        return len(self._timers)


class TimerHandle:
    """A function that waits for its time, returned by `self.after`."""

    def __init__(self, due: int, function: Callable[[], object]) -> None:
        self._due, self._function = due, function
        self._lock = threading.Lock()
        self._is_over = False

    def cancel(self) -> bool:
        """Do not call the function. Returns False if it was called or cancelled before."""
        with self._lock:
            was_over, self._is_over = self._is_over, True
        return not was_over

    @property
    def pending(self) -> bool:
        """Whether the function still waits for its time."""
        return not self._is_over

    def __repr__(self) -> str:
        return f"<{'pending' if self.pending else 'over'}: {self._function!r}>"


class Agenda:
    """The times at which the timers of one component are due, but `compute`. Safe to use from any thread.

    Of those due at the same time, declared timers come first, in the order of their declaration, then functions in the
    order in which `after` was called.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self._name, self._clock = name, clock
        self._lock = threading.Lock()
        self.timers: list[Timer] = []
        """The declared ones."""
        self._once: list[tuple[int, int, TimerHandle]] = []
        self._numbers = itertools.count()
        self._wake = threading.Event()
        self._runs = self._closed = False
        self._fire: Callable[[Timer | TimerHandle], object] | None = None
        self._thread: threading.Thread | None = None

    def add(self, name: str, period: float, method: Callable[[], object]) -> Timer:
        timer = Timer(name, Beat(period, self._clock.now()), self._wake.set, method)
        self.timers.append(timer)
        return timer

    def after(self, seconds: float, function: Callable[[], object]) -> TimerHandle:
        if not 0 <= seconds <= MAX_SECONDS:
            raise ValueError(f"a function is called after 0 to {MAX_SECONDS:g} seconds, not after {seconds!r}")
        if not callable(function) or inspect.iscoroutinefunction(function):
            raise TypeError(f"`after` takes a function without arguments, and no `async def`, not {function!r}")
        handle = TimerHandle(self._clock.now() + ns(seconds), function)
        with self._lock:
            if len(self._once) >= MAX_PENDING:
                self._once = sorted(each for each in self._once if each[2].pending)
            if len(self._once) >= MAX_PENDING:
                raise ComponentError(f"{MAX_PENDING} functions wait for their time; call `after` less often")
            if self._closed:
                handle.cancel()
            else:
                heapq.heappush(self._once, (handle._due, next(self._numbers), handle))
            self._need_thread()
        self._wake.set()
        return handle

    def resume(self) -> None:
        """Let timers run from now on, each with a call at once."""
        now = self._clock.now()
        for each in self.timers:
            each._beat.restart(now)
        self._runs = not self._closed
        self._wake.set()

    def pause(self) -> None:
        """Let no timer run until `resume`."""
        self._runs = False

    def due(self) -> int:
        """The time at which the first timer is due that is not running. It may have passed."""
        with self._lock:
            return self._first()[0]

    def take(self) -> Timer | TimerHandle | None:
        """The first timer or function, if it is due. The caller calls `run` for it."""
        reached = self._clock.reached()
        with self._lock:
            due, first = self._first()
            if due > reached:
                return None
            if isinstance(first, Timer):
                first._is_running = True
                first._beat.begun()
            elif first:
                heapq.heappop(self._once)
        return first

    def run(self, taken: Timer | TimerHandle, call: Callable[[Callable[[], object]], object]) -> float:
        """Call the method or the function by `call`, inside the monitor. Returns the seconds that it took.

        If timers are paused meanwhile, it is called later.
        """
        begun = self._clock.now()
        if isinstance(taken, TimerHandle):
            with self._lock:
                if not self._runs and taken.pending and not self._closed:
                    heapq.heappush(self._once, (taken._due, next(self._numbers), taken))
                    return 0.0
            if taken.cancel():
                call(taken._function)
            return (self._clock.now() - begun) / SECOND
        try:
            if self._runs:
                call(taken._method)
                taken.calls += 1
                taken._beat.done(self._clock.now())
        finally:
            taken._is_running = False
            self._wake.set()
        return (self._clock.now() - begun) / SECOND

    def begin(self, fire: Callable[[Timer | TimerHandle], object]) -> None:
        """From now on, pass each timer to `fire` when it is due. `fire` must not wait.

        Raises ComponentError if there are timers and no thread can start; so does `after` for the first function.
        """
        with self._lock:
            self._fire = fire
            self._need_thread()

    def end(self) -> None:
        """Call nothing any more; functions that wait are cancelled."""
        with self._lock:
            self._closed, self._runs = True, False
            once, self._once = self._once, []
        for _, _, handle in once:
            handle.cancel()
        self._wake.set()

    def close(self) -> None:
        """End, and wait for the thread."""
        self.end()
        if self._thread and self._thread is not threading.current_thread():
            self._thread.join(_STUCK)

    def _need_thread(self) -> None:
        """Start the thread if there is something to wait for. Called with the lock."""
        if not self._fire or self._thread or self._closed or not (self.timers or self._once):
            return
        self._thread = threading.Thread(target=self._loop, args=(self._fire,), name=f"{self._name}-timers")
        self._clock.wait(self._wake, self._clock.reached())  # so that a clock that others move knows of the thread
        if not start_thread(self._thread):
            self._thread = None
            raise ComponentError(f"timers cannot run: {NO_THREAD}")

    def _first(self) -> tuple[int, Timer | TimerHandle | None]:
        """What is due first of all that is not running, with its time. Called with the lock."""
        due, first = NEVER, None
        if not self._runs:
            return due, first
        for each in self.timers:
            if not each._is_running and each._beat.next < due:
                due, first = each._beat.next, each
        while self._once and not self._once[0][2].pending:
            heapq.heappop(self._once)
        if self._once and self._once[0][0] < due:
            return self._once[0][0], self._once[0][2]
        return due, first

    def _loop(self, fire: Callable[[Timer | TimerHandle], object]) -> None:
        while not self._closed:
            if taken := self.take():
                fire(taken)
            elif self._clock.wait(self._wake, self.due()):
                self._wake.clear()
