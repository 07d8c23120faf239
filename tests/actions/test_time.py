"""Goals in virtual time and in lock-step: each run is the same, and both are the same."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from robocomp_py.actions.client import ActionProxy
from robocomp_py.actions.goal import MOST_QUEUED, Goal
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.errors import Busy, Cancelled, Timeout, Unreachable
from robocomp_py.runtime.clock import SECOND
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing.actions import DOCK, FLOOD, FOREVER, GO_TO, PILOT, TURN, Pilot
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.base import find_transport
from robocomp_py.virtual.simulation import Simulation

from ..runtime.running import make, running
from ..virtual.parts import part


class PilotProxy(ActionProxy):
    interface = PILOT

    def goTo(self, steps: int) -> Goal[int, Any]:
        return self._begin(GO_TO, (steps,), False, None)

    def turn(self, steps: int) -> Goal[int, Any]:
        return self._begin(TURN, (steps,), False, None)

    def dock(self, steps: int, *, detached: bool = False) -> Goal[int, Any]:
        return self._begin(DOCK, (steps,), detached, None)


class Ship(Pilot, Worker[None]):
    component = Component(
        "ship", (Port(Verb.IMPLEMENTS, PILOT, policies=(("turn", "preempt"), ("dock", "queue"))),), period=0.02
    )
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


# The rules that the conformance class tests for transports, in virtual time.


class Mate(Captain):
    """Does what a test tells it, once."""

    task: Callable[[Mate], object]

    def compute(self) -> None:
        if not self.is_done:
            type(self).task(self)
            self.is_done = True


def sail(task: Callable[[Mate], object], seconds: float = 0.0) -> tuple[Ship, Mate]:
    """Both components, when the task is done and further seconds have passed."""
    kind = type("Mate", (Mate,), {"task": staticmethod(task)})
    with Simulation([part(Ship), part(kind, "mate")]) as simulation:
        mate = simulation["mate"].worker
        assert simulation.run(until=lambda: mate.is_done, at_most=60.0), simulation.failed
        simulation.run(seconds)
        assert not simulation.errors
        return simulation["ship"].worker, mate


def test_a_hundred_goals_are_executed_in_their_order() -> None:
    def task(mate: Mate) -> None:
        goals = [mate.pilot_proxy.dock(number % 3) for number in range(100)]
        for goal in goals:
            mate._outcome(goal)

    ship, mate = sail(task)
    assert ship.begun == [number % 3 for number in range(100)]
    assert [int(each.partition(" at ")[0]) for each in mate.entries] == ship.begun


def test_a_queue_is_bounded() -> None:
    def task(mate: Mate) -> None:
        first, *others = [mate.pilot_proxy.dock(steps) for steps in (FOREVER, *[0] * MOST_QUEUED)]
        with pytest.raises(Busy):
            mate.pilot_proxy.dock(0)
        first.cancel()
        assert [goal.result(5.0) for goal in others] == [0] * MOST_QUEUED

    sail(task)


def test_of_a_flood_of_feedback_the_newest_is_there() -> None:
    def task(mate: Mate) -> None:
        goal = mate.pilot_proxy.goTo(FLOOD)
        assert goal.result(5.0) == FLOOD
        assert goal.feedback.left == FLOOD - 1

    sail(task)


def test_a_cancel_that_races_the_result_has_one_end() -> None:
    ends = []

    def task(mate: Mate) -> None:
        for number in range(40):
            goal = mate.pilot_proxy.dock(number % 4)
            mate.sleep(0.02 * (number % 5))
            goal.cancel()
            try:
                ends.append((goal.result(5.0) == number % 4, goal.status.name))
            except Cancelled:
                ends.append((False, goal.status.name))

    sail(task)
    assert set(ends) == {(True, "SUCCEEDED"), (False, "CANCELED")}


def test_a_goal_is_refused_while_another_one_is_active() -> None:
    def task(mate: Mate) -> None:
        goal = mate.pilot_proxy.goTo(FOREVER)
        with pytest.raises(Busy):
            mate.pilot_proxy.goTo(1)
        goal.cancel()
        mate._outcome(goal)
        assert mate.pilot_proxy.goTo(1).result(5.0) == 1

    ship, _ = sail(task)
    assert ship.begun == [1], "the first one was cancelled before its turn"


def test_a_result_is_waited_for_longer_than_a_server_waits_for_signs_of_life() -> None:
    def task(mate: Mate) -> None:
        goal = mate.pilot_proxy.goTo(FOREVER)
        with pytest.raises(Timeout):
            goal.result(12.5)
        mate._note("late")
        goal.cancel()
        mate._outcome(goal)

    _, mate = sail(task)
    assert mate.entries == ["late at 12500", "cancelled at 12520"]


def test_callbacks_are_called_before_the_wait_ends() -> None:
    def task(mate: Mate) -> None:
        future = mate.pilot_proxy.goTo(3).future()
        future.add_done_callback(lambda done: mate._note(f"called with {done.result()}"))
        mate._note(future.result(5.0))

    _, mate = sail(task)
    assert mate.entries == ["called with 3 at 80", "3 at 80"]


def test_the_end_of_a_server_ends_its_goals_and_further_ones_are_unreachable() -> None:
    ships: list[Ship] = []

    class Sinking(Ship):
        def initialize(self) -> None:
            ships.append(self)

    def task(mate: Mate) -> None:
        goal = mate.pilot_proxy.goTo(FOREVER)
        mate.sleep(0.2)
        ships[0].stop()
        with pytest.raises(Unreachable):
            goal.result(5.0)
        mate._note("over")
        with pytest.raises(Unreachable):
            mate.pilot_proxy.goTo(1)

    kind = type("Mate", (Mate,), {"task": staticmethod(task)})
    with Simulation([part(Sinking, "ship"), part(kind, "mate")]) as simulation:
        mate = simulation["mate"].worker
        assert simulation.run(until=lambda: mate.is_done, at_most=60.0), simulation.failed
    assert mate.entries == ["over at 200"]


def test_goals_of_a_client_that_stops_are_cancelled_unless_detached() -> None:
    goals: list[Goal[int, Any]] = []

    def task(mate: Mate) -> None:
        goals.append(mate.pilot_proxy.goTo(FOREVER))
        mate.pilot_proxy.dock(300, detached=True)
        mate.pilot_proxy.dock(7, detached=True)
        mate.sleep(0.2)
        mate.stop()

    ship, _ = sail(task, seconds=10.0)
    assert ship.told_to_stop == 1
    assert ship.begun == [FOREVER, 300, 7], "the second one began when the first one was over"
    assert goals[0].done
