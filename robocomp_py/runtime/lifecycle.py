"""The life of a component, as a table.

    STARTING ──▶ INITIALIZE ──▶ COMPUTE ◀────────────── RESTORE
                                   │ goToEmergency          ▲
                                   └──▶ EMERGENCY ──────────┘ goToRestore
    any of these but STARTING ──▶ FINISH ──▶ ENDED ◀── STARTING

`compute` and `emergency` are called every period, `initialize`, `restore` and `finish` once. A component that
stops while it waits for its peers (STARTING) ends without `finish`.
"""

from __future__ import annotations

from enum import StrEnum

from .clock import SECOND, ns


class State(StrEnum):
    STARTING = "starting"
    INITIALIZE = "initialize"
    COMPUTE = "compute"
    EMERGENCY = "emergency"
    RESTORE = "restore"
    FINISH = "finish"
    ENDED = "ended"


class Event(StrEnum):
    CONNECTED = "connected"  # everything required is visible
    DONE = "done"  # the hook of the present state has returned
    ALARM = "goToEmergency"
    RECOVERED = "goToRestore"
    STOP = "stop"


TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.STARTING, Event.CONNECTED): State.INITIALIZE,
    (State.INITIALIZE, Event.DONE): State.COMPUTE,
    (State.COMPUTE, Event.ALARM): State.EMERGENCY,
    (State.EMERGENCY, Event.RECOVERED): State.RESTORE,
    (State.RESTORE, Event.DONE): State.COMPUTE,
    **{
        (state, Event.STOP): State.FINISH for state in (State.INITIALIZE, State.COMPUTE, State.EMERGENCY, State.RESTORE)
    },
    (State.STARTING, Event.STOP): State.ENDED,
    (State.FINISH, Event.DONE): State.ENDED,
}


def after(state: State, event: Event) -> State:
    """The next state; an event without a transition leaves the state unchanged."""
    return TRANSITIONS.get((state, event), state)


class Beat:
    """A periodic schedule without drift. Missed beats are counted and never made up for.

    Times are those of a clock, in nanoseconds: see `clock`.
    """

    def __init__(self, period: float, now: int) -> None:
        self.period = period
        self.overruns = 0
        self._last = now - ns(period)

    @property
    def period(self) -> float:
        """Seconds; may be changed, and then holds from the last beat on."""
        return self._period / SECOND

    @period.setter
    def period(self, seconds: float) -> None:
        self._period = max(1, ns(seconds))

    @property
    def next(self) -> int:
        """The time of the next beat; it may have passed."""
        return self._last + self._period

    def due(self, now: int) -> int:
        """The time of the next beat; `now` if it is due."""
        return max(now, self._last + self._period)

    def restart(self, now: int) -> None:
        """Begin a new schedule with a beat at `now`."""
        self._last = now - self._period

    def begun(self) -> None:
        """Note that the work of the next beat begins."""
        self._last += self._period

    def done(self, now: int) -> None:
        """Note that the work of this beat is done; beats missed meanwhile are counted and skipped."""
        late = now - (self._last + self._period)
        if late > 0:
            missed = late // self._period + 1
            self.overruns += missed
            self._last += missed * self._period
