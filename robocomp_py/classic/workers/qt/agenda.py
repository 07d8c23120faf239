"""The schedule of a component: queued calls, and alarms. The clock is a parameter.

The earliest is done first. A repeating alarm keeps its rhythm: missed times are skipped and counted.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable

from ....errors import ComponentError

MAX_POSTED = 10_000
"""Maximum number of waiting calls."""


class Alarm:
    """Calls a function after an interval; repeatedly unless `single`."""

    def __init__(self, ring: Callable[[], object], single: bool = False) -> None:
        self.ring, self.single = ring, single
        self.interval = 0.0
        """The interval in seconds."""
        self.at: float | None = None
        """Time of the next call."""
        self.ringing = False


class Agenda:
    """Any thread may post and change; the thread that calls `do` runs what is due."""

    def __init__(self, wake: Callable[[], None], clock: Callable[[], float] = time.monotonic) -> None:
        """`wake` is called, on the changing thread, when something may be due earlier than `due` has returned."""
        self.missed = 0
        """Number of skipped alarms, because something took too long."""
        self.closed = False
        self._wake, self._clock = wake, clock
        self._lock = threading.Lock()
        self._posted: deque[tuple[float, Callable[[], object]]] = deque()
        self._alarms: list[Alarm] = []

    def now(self) -> float:
        return self._clock()

    def post(self, call: Callable[[], object]) -> None:
        with self._lock:
            if self.closed:
                return
            if len(self._posted) >= MAX_POSTED:
                raise ComponentError(
                    f"{MAX_POSTED} calls wait to be made already; a thread emits signals faster than they are handled"
                )
            self._posted.append((self._clock(), call))
        self._wake()

    def start(self, alarm: Alarm, interval: float) -> None:
        """Start an alarm; one that was started before begins anew."""
        with self._lock:
            alarm.interval = interval
            if self.closed:
                return
            alarm.at = self._clock() + interval
            if alarm not in self._alarms:
                self._alarms.append(alarm)
        self._wake()

    def stop(self, alarm: Alarm) -> None:
        with self._lock:
            alarm.at = None
            if alarm in self._alarms:
                self._alarms.remove(alarm)

    def due(self, now: float) -> float | None:
        """Seconds until something is due; 0: now; None: nothing."""
        with self._lock:
            first = min(_time_of(self._next_alarm()), self._posted[0][0] if self._posted else math.inf)
        return None if first == math.inf else max(0.0, first - now)

    def do(self, now: float) -> bool:
        """Do one thing that is due; False if there is none."""
        with self._lock:
            alarm = self._next_alarm()
            if self._posted and self._posted[0][0] <= min(now, _time_of(alarm)):
                alarm = None
                call = self._posted.popleft()[1]
            elif alarm and _time_of(alarm) <= now:
                self._set_again(alarm, now)
                alarm.ringing = True  # not recursively, if its callback runs `do`
                call = alarm.ring
            else:
                return False
        try:
            call()
        finally:
            if alarm:
                alarm.ringing = False
        return True

    def close(self) -> None:
        """Drop everything, and ignore what is added later."""
        with self._lock:
            self.closed = True
            for alarm in self._alarms:
                alarm.at = None
            self._alarms.clear()
            self._posted.clear()

    def _next_alarm(self) -> Alarm | None:
        return min((each for each in self._alarms if not each.ringing), key=_time_of, default=None)

    def _set_again(self, alarm: Alarm, now: float) -> None:
        if alarm.single or alarm.at is None:
            alarm.at = None
            self._alarms.remove(alarm)
            return
        alarm.at += alarm.interval
        if alarm.at > now:
            return
        if not alarm.interval:
            alarm.at = now
            return
        late = math.floor((now - alarm.at) / alarm.interval) + 1
        self.missed += late
        alarm.at += late * alarm.interval


def _time_of(alarm: Alarm | None) -> float:
    return math.inf if alarm is None or alarm.at is None else alarm.at
