"""Actions of generated components, on a worker's own thread and in virtual time."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli import rcgen
from robocomp_py.errors import Busy, Cancelled, ComponentError, RemoteFailure, Timeout, Unreachable
from robocomp_py.runtime.worker import check_methods
from robocomp_py.testing.components import ComponentTest, late, load_component
from robocomp_py.testing.patience import SOON

IDSL = """
module RoboCompPilot
{
    exception Blocked { string by; };
    interface Pilot
    {
        [action] int fly(int steps) feedback(int left) throws Blocked;
        [action] void land();
        [query] int flown();
    };
};
"""
SHIP = 'import "Pilot.idsl"; Component ship { language python; period 10 ms; Communications { implements Pilot; }; };'
CREW = 'import "Pilot.idsl"; Component crew { language python; period 10 ms; Communications { requires Pilot; }; };'
SHIP_CODE = """
from .generic import RoboCompPilot
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    flown = 0

    def Pilot_fly(self, goal, steps):
        if steps < 0:
            raise RoboCompPilot.Blocked("a bird")
        for number in range(steps):
            self.flown += 1
            goal.feedback(left=steps - number)
            yield
        return steps if steps != 13 else "no number"

    def Pilot_land(self, goal):
        yield

    def Pilot_flown(self):
        return self.flown
"""
CREW_CODE = """
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    outcome = goal = None

    def compute(self):
        if self.goal is None:
            self.goal = self.pilot_proxy.fly(3)
        elif self.outcome is None:
            try:
                self.outcome = self.goal.result(5.0)
            except Exception as exc:
                self.outcome = exc
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("actions")
    (folder / "Pilot.idsl").write_text(IDSL)
    for name, text, code in (("ship", SHIP, SHIP_CODE), ("crew", CREW, CREW_CODE)):
        (folder / name).mkdir()
        (folder / name / f"{name}.cdsl").write_text(text.replace('"Pilot', '"../Pilot'))
        assert rcgen.main([str(folder / name / f"{name}.cdsl")]) == 0
        (folder / name / "specificworker.py").write_text(code)
    return folder


@pytest.fixture(params=[False, True], ids=["real", "virtual"])
def ship(request: pytest.FixtureRequest, folder: Path) -> Iterator[ComponentTest]:
    with ComponentTest(load_component(folder / "ship"), virtual=request.param) as test:
        yield test


def crew(folder: Path, virtual: bool, fake: Any) -> Any:
    """How the goal of a client ends if its server does this."""
    with ComponentTest(load_component(folder / "crew"), virtual=virtual, pilot={"fly": fake}) as test:
        test.wait_for(lambda: test.worker.outcome is not None)
        assert test.received("pilot.fly") == [(3,)]
        return test.worker.outcome


def test_a_component_executes_goals(ship: ComponentTest) -> None:
    goal = ship.call("Pilot.fly", 5)
    assert goal.result(SOON) == 5
    assert goal.feedback.left == 1
    assert ship.call("Pilot.flown") == 5
    assert ship.call("Pilot.land").result(SOON) is None


def test_one_goal_of_an_action_runs_at_a_time(ship: ComponentTest) -> None:
    goal = ship.call("Pilot.fly", 10**6)
    with pytest.raises(Busy, match="another one is active"):
        ship.call("Pilot.fly", 1)
    assert ship.call("Pilot.land").result(SOON) is None, "another action"
    goal.cancel()
    with pytest.raises(Cancelled):
        goal.result(SOON)


def test_the_declared_exception_reaches_the_client(ship: ComponentTest) -> None:
    module = type(ship.worker).__module__.rpartition(".")[0]
    blocked = importlib.import_module(f"{module}.generic.RoboCompPilot").Blocked
    with pytest.raises(blocked, match="a bird"):
        ship.call("Pilot.fly", -1).result(SOON)


def test_a_result_of_a_wrong_type_fails(ship: ComponentTest) -> None:
    goal = ship.call("Pilot.fly", 13)
    with pytest.raises(RemoteFailure):
        goal.result(SOON)
    assert (str(goal.status), f"{goal.status}", goal.status) == ("ABORTED", "ABORTED", 6)


@pytest.mark.parametrize("virtual", [False, True])
def test_a_fake_answers_goals(folder: Path, virtual: bool) -> None:
    assert crew(folder, virtual, 7) == 7
    assert crew(folder, virtual, lambda steps: steps * 2) == 6
    assert crew(folder, virtual, late(0.05, 8)) == 8
    assert isinstance(crew(folder, virtual, Unreachable("gone")), Unreachable)


def test_a_fake_may_be_too_late(folder: Path) -> None:
    assert isinstance(crew(folder, True, late(60.0, 8)), Timeout)


def test_a_handler_without_yield_is_refused(folder: Path) -> None:
    ship = load_component(folder / "ship")
    plain = type("SpecificWorker", (ship,), {"Pilot_fly": lambda self, goal, steps: 7})
    with pytest.raises(ComponentError, match=r"Pilot_fly must contain a `yield`, because it executes an action"):
        check_methods(plain)


def test_a_handler_that_is_missing_is_shown(folder: Path) -> None:
    ship = load_component(folder / "ship")
    generic = next(each for each in ship.__mro__ if each.__name__ == "GenericWorker")
    with pytest.raises(ComponentError, match="lacks the method"):
        check_methods(type("SpecificWorker", (generic,), {}))
