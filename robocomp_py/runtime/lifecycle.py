"""The life of a component, as a table.

    STARTING ──▶ INITIALIZE ──▶ COMPUTE ◀────────────── RESTORE
                                   │ goToEmergency          ▲
                                   └──▶ EMERGENCY ──────────┘ goToRestore
    any of these but STARTING ──▶ FINISH ──▶ ENDED ◀── STARTING

`compute` and `emergency` are called every period, `initialize`, `restore` and `finish` once. While
it waits for others (STARTING) there is nothing to finish yet.
"""

from __future__ import annotations

import math
from enum import StrEnum


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
    """The next state; events that mean nothing in a state leave it as it is."""
    return TRANSITIONS.get((state, event), state)


class Beat:
    """When to do what is done every `period` seconds: without drift, and never twice to catch up."""

    def __init__(self, period: float, now: float) -> None:
        self.period = period
        """May be changed; the next beat is then so long after the last one."""
        self.overruns = 0
        self._last = now - period

    def due(self, now: float) -> float:
        """Seconds until the next beat; 0 if it is due."""
        return max(0.0, self._last + self.period - now)

    def done(self, now: float) -> None:
        """A beat was kept; those missed meanwhile are counted and left out."""
        self._last += self.period
        late = now - (self._last + self.period)
        if late > 0:
            missed = math.floor(late / self.period) + 1
            self.overruns += missed
            self._last += missed * self.period
