"""A clock that passes by itself, and that the components of a network follow without waiting for each other.

One component leads. It publishes the time and the speed of its clock (`Clock.tick`) twenty times a second, and whenever
they change. Between two ticks the clock of a follower goes on by itself at that speed. A component whose own code
publishes `Clock`, for example because it plays a recording, leads by that, and keeps the clock of its machine.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..contract.component import Component, Port
from ..contract.interface import Verb
from ..errors import Closed, ComponentError, RobocompError
from ..runtime.clock import NEVER, SECOND, ns
from ..runtime.ports import Proxy
from ..threads import NO_THREAD, start_thread
from ..wire import names
from .links import Hears, Publishes
from .pace import MAX_SPEED, MAX_STEP
from .RoboCompClock import CLOCK_INTERFACE, CLOCKCONTROL_INTERFACE, ClockState

if TYPE_CHECKING:
    from ..runtime.settings import Settings

log = logging.getLogger("robocomp.clock")

PERIOD = 0.05
"""Seconds between two ticks."""

_SILENCE = 1.0
"""Seconds without a tick after which the clock of a follower stands still."""

_SLICE = 0.05
"""Longest wait in seconds until a follower looks at its clock again, whose speed may have changed."""

_BACK = SECOND
"""How far a clock goes back, in ns, if its leader was restarted. Less is the way of a tick through the network."""

_TELL = 5.0
"""Seconds after which the log tells that there is no tick."""

_STUCK = 5.0
"""Seconds that closing waits for the thread."""


class Passing:
    """A time that passes by itself at some speed. Safe to use from any thread."""

    def __init__(
        self,
        is_over: Callable[[], bool],
        longest: float = math.inf,
        machine: Callable[[], float] = time.monotonic,
    ) -> None:
        """It stands still `longest` seconds after it was told how it stands, until it is told again.

        Once `is_over` returns True, it passes as that of the machine. `machine` is its time in seconds.
        """
        self._is_over, self._longest, self._machine = is_over, longest, machine
        self._lock = threading.Lock()
        self._at, self._since, self._speed = 0, machine(), 0.0
        self._until = NEVER
        self._last = 0
        self._is_free = False
        """Whether it passes as that of the machine."""

    def told(self, now: int, speed: float, until: int = NEVER) -> None:
        """From now on, this is the time, and this its speed, until it stands still at `until`."""
        with self._lock:
            if not self._is_free:
                self._at, self._since, self._speed, self._until = now, self._machine(), speed, until

    def now(self) -> int:
        """It never goes back: if it was told an earlier time, it stands still until that is over."""
        with self._lock:
            if not self._is_free and self._is_over():
                self._is_free, self._longest = True, math.inf
                self._at, self._since, self._speed, self._until = self._last, self._machine(), 1.0, NEVER
            passed = min(self._machine() - self._since, self._longest)
            now = min(self._at + int(passed * SECOND * self._speed), self._until)
            self._last = max(self._last, now)
            return self._last

    reached = now

    def wait(self, wake: threading.Event, until: int) -> bool:
        left = until - self.now()
        if left <= 0 or wake.is_set():
            return wake.is_set()
        speed = self._speed
        return wake.wait(min(_SLICE, left / SECOND / speed) if speed else _SLICE)


class Followed:
    """What a component needs to follow a clock; the same surface as `Lockstep`, whose methods have the same order."""

    threads = None
    counts = None
    clock: Passing

    def __init__(self, settings: Settings, is_over: Callable[[], bool]) -> None:
        """`is_over` returns whether the component is about to end."""
        assert settings.clock
        self._settings = settings.clock
        self._leader = names.whole(settings.clock.leader, settings.namespace)
        self._is_over = is_over
        self.wake = threading.Event()

    def open(self, connections: Any) -> None:
        """`connections` are those of the component."""

    def begin(self) -> None: ...

    def wait(self) -> None: ...

    def close(self) -> None: ...


class Following(Followed):
    """A follower."""

    def __init__(self, settings: Settings, is_over: Callable[[], bool]) -> None:
        super().__init__(settings, is_over)
        self.clock = Passing(is_over, _SILENCE)
        self._heard = threading.Event()
        self._newest = 0
        self._told_back = False

    def open(self, connections: Hears) -> None:
        connections.hear(Port(Verb.SUBSCRIBES, CLOCK_INTERFACE), self, self._leader)

    def Clock_tick(self, now: int, speed: float) -> None:
        if now < self._newest - _BACK and not self._told_back:
            self._told_back = True
            back, then = now / SECOND, self._newest / SECOND
            log.warning("the clock of %s went back to %g s; it stands still until %g s", self._leader[1:], back, then)
        self._newest = max(self._newest, now)
        self.clock.told(now, min(max(speed, 0.0), MAX_SPEED))
        self._heard.set()

    def wait(self) -> None:
        """Wait for the first tick, or until the component is about to end."""
        begun, is_told = time.monotonic(), False
        while not self._heard.wait(0.1) and not self._is_over():
            if not is_told and time.monotonic() - begun > _TELL:
                is_told = True
                log.warning("the clock stands still: %s, which leads it, tells no time", self._leader[1:])


class Leading(Followed):
    """The leader. Its clock begins at 0 when it is ready."""

    def __init__(self, settings: Settings, is_over: Callable[[], bool]) -> None:
        super().__init__(settings, is_over)
        self.clock = Passing(is_over)
        self._speed = self._settings.speed
        self._is_paused = False
        self._until: int | None = None
        """The end of a step."""
        self._changing = threading.RLock()
        self._news = threading.Event()
        self._closing = False
        self._proxy: _ClockProxy | None = None
        self._close: Callable[[], None] = lambda: None
        self._thread: threading.Thread | None = None

    def open(self, connections: Publishes) -> None:
        self._proxy, self._close = connections.publish(Port(Verb.PUBLISHES, CLOCK_INTERFACE, proxy=_ClockProxy))
        connections.serve(Port(Verb.IMPLEMENTS, CLOCKCONTROL_INTERFACE), self)

    def begin(self) -> None:
        with self._changing:
            if not self._is_paused:
                self._go_on(self._speed)
        self._thread = threading.Thread(target=self._run, name=f"{self._leader[1:]}-clock", daemon=True)
        if not start_thread(self._thread):
            raise ComponentError(f"the clock cannot be led: {NO_THREAD}")

    def close(self) -> None:
        self._closing = True
        self._news.set()
        if self._thread and self._thread.ident:
            self._thread.join(_STUCK)
        self._close()

    # What those ask that drive the clock.

    def ClockControl_state(self) -> ClockState:
        with self._changing:
            followers = [names.whole(each, "")[1:] for each in self._settings.followers]
            return ClockState(self.clock.now(), self._speed, self._is_paused, followers)

    def ClockControl_pause(self) -> None:
        with self._changing:
            self._is_paused, self._until = True, None
            self._go_on(0.0)

    def ClockControl_resume(self) -> None:
        with self._changing:
            self._is_paused, self._until = False, None
            self._go_on(self._speed)

    def ClockControl_step(self, seconds: float) -> int:
        if not 0 < seconds <= MAX_STEP:
            raise ValueError(f"a step takes a positive number of seconds, at most {MAX_STEP:g}, not {seconds!r}")
        with self._changing:
            self._until = (self._until or self.clock.now()) + ns(seconds)
            self._is_paused = False
            self._go_on(self._speed)
            return self._until

    def ClockControl_setSpeed(self, speed: float) -> None:
        if not 0 < speed <= MAX_SPEED:
            raise ValueError(
                f"a speed is a positive number, at most {MAX_SPEED:g}, not {speed!r}; "
                "a clock is as fast as possible only in lock-step"
            )
        with self._changing:
            self._speed = speed
            if not self._is_paused:
                self._go_on(speed)

    def _go_on(self, speed: float) -> None:
        self.clock.told(self.clock.now(), speed, NEVER if self._until is None else self._until)
        self._news.set()

    # The thread.

    def _run(self) -> None:
        is_told = False
        while not self._closing:
            try:
                self._tick()
                is_told = False
            except Closed:
                return
            except RobocompError as exc:
                if not is_told:
                    log.warning("the time could not be told: %s", exc)
                is_told = True
            with self._changing:
                left = NEVER if self._until is None else self._until - self.clock.now()
                speed = self._speed
            self._news.wait(min(PERIOD, max(0.0, left / SECOND / speed)))
            self._news.clear()

    def _tick(self) -> None:
        assert self._proxy
        with self._changing:
            now = self.clock.now()
            if self._until is not None and now >= self._until:
                self._is_paused, self._until = True, None
                self.clock.told(now, 0.0)
            speed = 0.0 if self._is_paused else self._speed
        self._proxy.tick(now, speed)


class _ClockProxy(Proxy):
    interface = CLOCK_INTERFACE

    def tick(self, now: int, speed: float) -> None:
        (operation,) = CLOCK_INTERFACE.operations
        self._send(operation, (now, speed), None)


def follow(settings: Settings, component: Component, is_over: Callable[[], bool]) -> Followed | None:
    """What lets a component follow the clock of its settings; None if its own code tells the time to the others."""
    assert settings.clock
    if names.whole(settings.clock.leader, settings.namespace) != names.whole(settings.instance, settings.namespace):
        return Following(settings, is_over)
    tells = any(port.verb is Verb.PUBLISHES and port.interface.name == CLOCK_INTERFACE.name for port in component.ports)
    return None if tells else Leading(settings, is_over)
