"""A component's state machine at run time: the worker takes fired transitions one after the other."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable

from ..contract.statemachine import StateMachine, Transition
from ..errors import ComponentError
from ..spelling import unknown
from .statechart import Chart, Step

log = logging.getLogger("robocomp.worker")

MAX_WAITING = 1000
"""Maximum number of fired transitions and events in the queue."""


class Machine:
    """`self.statemachine` of a worker. May be used from any thread.

    Firing (`self.t_a_to_b()`, `send`) never waits. After the current call has returned, the worker takes the fired
    transitions in order. It calls all `sm_` methods of one transition before it takes the next.
    """

    def __init__(self, machine: StateMachine, enter: Callable[[str], None], wake: Callable[[], None]) -> None:
        self.name = machine.name
        self._chart = Chart(machine)
        self._enter, self._wake = enter, wake
        self._lock = threading.Lock()
        self._queue: deque[Transition | str] = deque()
        self._own: deque[str] = deque()
        """Events of the machine itself, which are taken before those in `_queue`."""
        self._active: tuple[str, ...] = ()
        self._told: set[str] = set()
        self._events = sorted({kind for each in machine.transitions for kind in each.events})

    @property
    def active(self) -> tuple[str, ...]:
        """The active states, each before the states inside it; none before the machine begins."""
        return self._active

    @property
    def ended(self) -> bool:
        """Whether the machine has reached its end state. The component continues."""
        return self._chart.ended(self._active)

    def send(self, event: str) -> None:
        """Take the transitions that this event triggers, given the states that are active then.

        Raises ValueError for an event that no transition of the machine matches.
        """
        if not self._chart.heard(event):
            raise ValueError(unknown("event", event, self._events))
        self._fire(event)

    def _fire(self, what: Transition | str) -> None:
        with self._lock:
            if len(self._queue) >= MAX_WAITING:
                said = what if isinstance(what, str) else what.trigger
                raise ComponentError(f"{said}: {MAX_WAITING} fired transitions are already waiting; fire fewer")
            self._queue.append(what)
        self._wake()

    # Called by the worker's thread only.

    @property
    def _waiting(self) -> int:
        return len(self._queue) + len(self._own)

    def _begin(self) -> None:
        """Enter the initial states."""
        self._go(Step((), self._chart.begin()))

    def _step(self) -> None:
        """Take the first fired transition or event, if its source is active."""
        with self._lock:
            what = (self._own or self._queue).popleft()
        match what:
            case Transition() if what.source not in self._active:
                self._tell(f"{what.trigger}() was ignored: `{what.source}` is not active")
            case Transition():
                self._go(self._chart.step(self._active, [what]))
            case event:
                chosen = self._chart.chosen(self._active, event)
                if chosen:
                    self._go(self._chart.step(self._active, chosen))

    def _go(self, step: Step) -> None:
        self._told.clear()
        active = set(self._active).difference(step.left)
        for name in step.entered:
            active.add(name)
            self._active = self._chart.ordered(active)
            self._enter(name)
        self._own += filter(self._chart.heard, self._chart.done(step.entered, active))
        if self._own:
            self._wake()
        if self.ended:
            log.info("the state machine %s has ended (%s)", self.name, ", ".join(self._active))

    def _tell(self, message: str) -> None:
        """Log a warning once, until the machine moves."""
        if message not in self._told:
            self._told.add(message)
            log.warning("%s; active: %s", message, ", ".join(self._active))


class Trigger:
    """Fires one transition of a worker's state machine: `self.t_one_to_two()`, or `.emit()` as with Qt's signals.

    The transition is taken after the current call. If its source is not active then, a warning is logged instead.
    """

    def __init__(self, machine: Machine, transition: Transition) -> None:
        self._machine, self._transition = machine, transition

    def __call__(self) -> None:
        self._machine._fire(self._transition)

    def emit(self) -> None:
        self()

    def __repr__(self) -> str:
        return f"<trigger {self._transition.trigger}>"
