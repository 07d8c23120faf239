"""A component's state machine by the names that RoboComp's generated code gave to its parts.

    self.defaultMachine.start()          self.compute_state.entered.connect(f)
    self.t_initialize_to_compute.emit()  self.timer.timeout.connect(self.t_compute_to_compute)

The engine is the one of all components; only what users call is made here.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from ...contract.statemachine import StateMachine, Transition, label
from ...runtime.statemachine import Machine, Trigger

Attempt = Callable[[Callable[[], object]], None]
"""Calls a slot, and logs what it raises."""


class Slots:
    """An event and its callbacks, with the methods of a Qt signal."""

    def __init__(self, attempt: Attempt) -> None:
        self._attempt = attempt
        self._connected: list[Any] = []

    def connect(self, slot: Any) -> None:
        self._connected.append(slot)

    def disconnect(self, slot: Any = None) -> None:
        self._connected = [each for each in self._connected if slot is not None and each != slot]

    def emit(self, *arguments: Any) -> None:
        for slot in list(self._connected):
            self._attempt(partial(slot.emit if hasattr(slot, "emit") else slot, *arguments))

    def __call__(self, *arguments: Any) -> None:
        self.emit(*arguments)


class Fired(Slots):
    """`self.t_a_to_b`: fires a transition. What it is called with is of no importance: signals pass their values."""

    def __init__(self, trigger: Trigger, attempt: Attempt) -> None:
        super().__init__(attempt)
        self._trigger = trigger

    def emit(self, *arguments: Any) -> None:
        self._trigger()
        super().emit(*arguments)


class StateName:
    """`self.compute_state`."""

    def __init__(self, name: str, engine: Machine, attempt: Attempt) -> None:
        self._name, self._engine = name, engine
        self.entered = Slots(attempt)

    def objectName(self) -> str:
        return self._name

    def active(self) -> bool:
        return self._name in self._engine.active


class Start:
    """`self.defaultMachine`: starts after the user has called `start` and the component's loop runs."""

    def __init__(self, engine: Machine, attempt: Attempt, wake: Callable[[], None]) -> None:
        self._engine, self._wake = engine, wake
        self.finished, self.started, self.stopped = Slots(attempt), Slots(attempt), Slots(attempt)
        self.wanted = False
        self.running = False

    def start(self) -> None:
        self.wanted = not self.running
        self._wake()

    def stop(self) -> None:
        self.wanted = self.running = False
        self.stopped.emit()

    def isRunning(self) -> bool:
        return self.running

    def configuration(self) -> tuple[str, ...]:
        return self._engine.active


class Chart:
    """The machine of one component instance; `enter` calls its method for a state."""

    def __init__(
        self, machine: StateMachine, enter: Callable[[str], None], attempt: Attempt, wake: Callable[[], None]
    ) -> None:
        self._call = enter
        self.engine = Machine(machine, self._enter, wake)
        self.start = Start(self.engine, attempt, wake)
        self._states = {each.name: StateName(each.name, self.engine, attempt) for each in machine.every_state()}
        self.names: dict[str, Any] = {machine.name: self.start}
        self.names |= {f"{label(name)}_state": state for name, state in self._states.items()}
        for transition in machine.triggers().values():
            fired = Fired(Trigger(self.engine, transition), attempt)
            self.names |= {name: fired for name in _spelled(transition)}

    @property
    def due(self) -> bool:
        """Whether a step is due."""
        return self.start.wanted or (self.start.running and bool(self.engine._waiting))

    def step(self) -> None:
        """Start, or take the transition that was triggered first."""
        if self.start.wanted:
            self.start.wanted, self.start.running = False, True
            self.engine._begin()
            self.start.started.emit()
        elif self.engine._waiting:
            self.engine._step()
        if self.engine.ended and self.start.running:
            self.start.running = False
            self.start.finished.emit()

    def _enter(self, state: str) -> None:
        self._call(state)
        self._states[state].entered.emit()


def _spelled(transition: Transition) -> tuple[str, str]:
    """Its present name, and its name until 2019."""
    return transition.trigger, f"{transition.source}to{label(transition.target)}"
