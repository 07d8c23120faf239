"""Goals in virtual time and in lock-step: each run is the same, and both are the same."""

from __future__ import annotations

from typing import Any

import pytest

from robocomp_py.actions.client import ActionProxy
from robocomp_py.actions.goal import Goal
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.errors import Cancelled
from robocomp_py.runtime.clock import SECOND
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing.actions import GO_TO, PILOT, TURN, Pilot
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.base import find_transport
from robocomp_py.virtual.simulation import Simulation

from ..runtime.test_run import make, running
from ..virtual.test_simulation import part


class PilotProxy(ActionProxy):
    interface = PILOT

    def goTo(self, steps: int) -> Goal[int, Any]:
        return self._begin(GO_TO, (steps,), False, None)

    def turn(self, steps: int) -> Goal[int, Any]:
        return self._begin(TURN, (steps,), False, None)


class Ship(Pilot, Worker[None]):
    component = Component("ship", (Port(Verb.IMPLEMENTS, PILOT, policies=(("turn", "preempt"),)),), period=0.02)
    middleware = "zeromq"


class Captain(Worker[None]):
    """Begins goals, and notes when what happens."""

    component = Component("captain", (Port(Verb.REQUIRES, PILOT, proxy=PilotProxy),), period=0.05)
    middleware = "zeromq"
    pilot_proxy: PilotProxy

    def __init__(self) -> None:
        self.entries: list[str] = []
        self.is_done = False

    def compute(self) -> None:
        if self.is_done:
            return
        self._note(self.pilot_proxy.goTo(7).result(5.0))
        goal = self.pilot_proxy.goTo(1000)
        self.sleep(0.31)
        self._note(f"{goal.status.name}, {goal.feedback.left:g} left")
        goal.cancel()
        self._outcome(goal)
        first, second = self.pilot_proxy.turn(1000), self.pilot_proxy.turn(3)
        self._outcome(first)
        self._outcome(second)
        self.is_done = True

    def _outcome(self, goal: Goal[Any, Any]) -> None:
        try:
            self._note(goal.result(5.0))
        except Cancelled:
            self._note("cancelled")

    def _note(self, what: object) -> None:
        self.entries.append(f"{what} at {self.now() * 1000 // SECOND}")


def in_virtual_time() -> tuple[list[str], str]:
    """What the captain notes, and the hash of all messages."""
    with Simulation([part(Ship), part(Captain)]) as simulation:
        captain: Captain = simulation["captain"].worker
        assert simulation.run(until=lambda: captain.is_done, at_most=60.0)
        return captain.entries, simulation.hash


def in_lockstep(middleware: str) -> list[str]:
    over = f"middleware={middleware}"
    leading = ['clock.leader="ship"', 'clock.followers=["captain"]', "clock.speed=0.0"]
    with (
        running(make(Ship, find_transport, over, *leading, name="ship"), ready=False),
        running(make(Captain, find_transport, over, 'clock.leader="ship"', name="captain"), ready=False) as captain,
    ):
        assert isinstance(captain, Captain)
        wait_until(lambda: captain.is_done)
        return captain.entries


def test_each_run_in_virtual_time_is_the_same() -> None:
    (entries, first), (_, second) = in_virtual_time(), in_virtual_time()
    assert first == second
    told = [each.partition(" at ")[0] for each in entries]
    assert told == ["7", "EXECUTING, 986 left", "cancelled", "cancelled", "3"]


@pytest.mark.parametrize("middleware", ["zeromq", "shm"])
def test_lock_step_is_as_virtual_time(middleware: str, own_runtime_folder: Any) -> None:
    assert in_lockstep(middleware) == in_virtual_time()[0]
