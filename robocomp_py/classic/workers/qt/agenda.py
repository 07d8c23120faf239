"""The schedule of a component: queued calls, and alarms. Times are those of its clock, in nanoseconds.

The earliest is done first. A repeating alarm keeps its rhythm: missed times are skipped and counted.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

from ....errors import ComponentError
from ....runtime.clock import NEVER, Clock

MAX_POSTED = 10_000
"""Maximum number of waiting calls."""


class Alarm:
    """Calls a function after an interval; repeatedly unless `single`."""

    def __init__(self, ring: Callable[[], object], single: bool = False) -> None:
        self.ring, self.single = ring, single
        self.interval = 0
        self.at: int | None = None
        """Time of the next call."""
        self.ringing = False


class Agenda:
    """Any thread may post and change; the thread that calls `do` runs what is due."""

    def __init__(self, wake: Callable[[], None], clock: Clock, least: int = 0) -> None:
        """`wake` is called, on the changing thread, when something may be due earlier than `due` has returned.

        `least` is the shortest interval of an alarm.
        """
        self.missed = 0
        """Number of skipped alarms, because something took too long."""
        self.closed = False
        self._wake, self._clock, self._least = wake, clock, least
        self._lock = threading.Lock()
        self._posted: deque[tuple[int, Callable[[], object]]] = deque()
        self._alarms: list[Alarm] = []

    def now(self) -> int:
        return self._clock.now()

    def post(self, call: Callable[[], object]) -> None:
        with self._lock:
            if self.closed:
                return
            if len(self._posted) >= MAX_POSTED:
                raise ComponentError(
                    f"{MAX_POSTED} calls wait to be made already; a thread emits signals faster than they are handled"
                )
            self._posted.append((self._clock.now(), call))
        self._wake()

    def start(self, alarm: Alarm, interval: int) -> None:
        """Start an alarm; one that was started before begins anew."""
        with self._lock:
            alarm.interval = interval = max(interval, self._least)
            if self.closed:
                return
            alarm.at = self._clock.now() + interval
            if alarm not in self._alarms:
                self._alarms.append(alarm)
        self._wake()

    def stop(self, alarm: Alarm) -> None:
        with self._lock:
            alarm.at = None
            if alarm in self._alarms:
                self._alarms.remove(alarm)

    def skip_to(self, now: int) -> None:
        """Let alarms that are late be due now, in their order. The time until then is not counted as missed."""
        with self._lock:
            self._alarms.sort(key=_time_of)
            for alarm in self._alarms:
                alarm.at = max(now, _time_of(alarm))

    def due(self, now: int) -> int:
        """The time at which something is due: `now` if it is late, NEVER if there is nothing."""
        with self._lock:
            first = min(_time_of(self._next_alarm()), self._posted[0][0] if self._posted else NEVER)
        return max(now, first)

    def do(self, now: int) -> bool:
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

    def _set_again(self, alarm: Alarm, now: int) -> None:
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
        late = (now - alarm.at) // alarm.interval + 1
        self.missed += late
        alarm.at += late * alarm.interval


def _time_of(alarm: Alarm | None) -> int:
    return NEVER if alarm is None or alarm.at is None else alarm.at
