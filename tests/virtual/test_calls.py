"""A test calls the components of a network in virtual time."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli import rcgen
from robocomp_py.errors import Cancelled, ComponentError, DeclaredError, RemoteFailure, Timeout
from robocomp_py.testing.simulation import Failure, Simulation

IDSL = """
module RoboCompCrane
{
    struct Place { float x; float y; };
    exception Blocked { string by; };
    interface Crane
    {
        [action] int lift(Place target, int steps) feedback(int left) throws Blocked;
        [query] Place shifted(Place from, float by);
        [command] void stop();
    };
    interface News { void said(string text); };
};
"""
CDSL = """
import "Crane.idsl";
Component crane { language python; period 10 ms; Communications { implements Crane; publishes News; }; };
"""
CODE = """
from .generic.RoboCompCrane import Blocked, Place
from .generic.genericworker import GenericWorker

class SpecificWorker(GenericWorker):
    stopped = False

    def Crane_lift(self, goal, target, steps):
        if target.x < 0:
            raise Blocked("a wall")
        if target.y > 8:
            raise ValueError("slipped")
        for number in range(steps):
            goal.feedback(left=steps - number)
            yield
        if target.y < 0:
            self.compute = lambda: 1 / 0
            yield
            yield
        return steps

    def Crane_shifted(self, from_, by):
        self.sleep(2.0)
        return Place(from_.x + by, from_.y)

    def Crane_stop(self):
        self.stopped = True
"""
LIFT = "crane/Crane/lift"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    (folder / "crane").mkdir()
    (folder / "crane/Crane.idsl").write_text(IDSL)
    (folder / "crane/crane.cdsl").write_text(CDSL)
    (folder / "site.ddsl").write_text('import "crane/crane.cdsl"; Deployment site { Component crane { }; };')
    assert rcgen.main([str(folder / "site.ddsl")]) == 0
    (folder / "crane/specificworker.py").write_text(CODE)
    return folder / "site.ddsl"


@pytest.fixture(autouse=True)
def no_threads_are_left() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    for each in set(threading.enumerate()) - before:
        each.join(30)
    assert set(threading.enumerate()) <= before


def test_a_goal_is_followed_to_its_result(site: Path) -> None:
    with Simulation(site) as sim:
        goal = sim.call(LIFT, target={"x": 1.0, "y": 2.0}, steps=50)
        sim.run(0.2)
        assert 20 < goal.feedback.left < 40
        assert goal.result(timeout=1.0) == 50
        assert sim.time == pytest.approx(0.5, abs=0.05)


def test_a_goal_is_cancelled(site: Path) -> None:
    with Simulation(site) as sim:
        goal = sim.call(LIFT, (1.0, 2.0), 5000)
        sim.run(1.0)
        goal.cancel()
        with pytest.raises(Cancelled):
            goal.result()


def test_a_goal_that_is_blocked_raises_what_the_interface_declares(site: Path) -> None:
    with Simulation(site) as sim:
        goal = sim.call(LIFT, (-1.0, 0.0), 5)
        with pytest.raises(Exception, match="a wall") as caught:
            goal.result(1.0)
        assert type(caught.value).__name__ == "Blocked"


def test_a_goal_that_takes_too_long_raises_timeout(site: Path) -> None:
    with Simulation(site) as sim:
        goal = sim.call(LIFT, (1.0, 0.0), 5000)
        with pytest.raises(Timeout, match=r"not over after 0\.5 s"):
            goal.result(0.5)


def test_a_component_that_fails_ends_the_wait_for_its_goal(site: Path) -> None:
    with Simulation(site) as sim:
        goal = sim.call(LIFT, (1.0, -1.0), 5)
        with pytest.raises(ComponentError, match="crane failed"):
            goal.result(5.0)
        assert sim.failed == ["crane"]


def test_queries_and_commands_are_called(site: Path) -> None:
    with Simulation(site) as sim:
        place = sim.call("crane/Crane/shifted", {"x": 1.0, "y": 7.0}, by=0.5)
        assert (place.x, place.y, sim.time) == (1.5, 7.0, 2.0)
        sim.call("crane/Crane/stop")
        sim.run(0.0)
        assert sim["crane"].worker.stopped


def test_undeclared_exceptions_of_a_goal_are_errors_and_declared_ones_are_not(site: Path) -> None:
    with Simulation(site) as sim:
        with pytest.raises(DeclaredError, match="a wall"):
            sim.call(LIFT, (-1.0, 0.0), 5).result(1.0)
        assert not sim.errors
        with pytest.raises(RemoteFailure, match="slipped"):
            sim.call(LIFT, (1.0, 9.0), 5).result(1.0)
        [failure] = sim.errors
        assert isinstance(failure, Failure)
        assert (failure.instance, failure.method) == ("crane", "SpecificWorker.Crane_lift")
        assert str(failure.exception) == "slipped"


def test_runs_with_calls_repeat(site: Path) -> None:
    hashes = set()
    for _ in range(2):
        with Simulation(site) as sim:
            sim.call(LIFT, (1.0, 0.0), 20).result(1.0)
            hashes.add(sim.hash)
    assert len(hashes) == 1


def test_what_is_wrong_with_a_call_is_told(site: Path) -> None:
    with Simulation(site) as sim:
        with pytest.raises(KeyError, match="did you mean `crane/Crane/lift`"):
            sim.call("crane/Crane/lifft")
        with pytest.raises(TypeError, match="unknown argument `to`"):
            sim.call(LIFT, to=1)
        with pytest.raises(TypeError, match="lacks `by`"):
            sim.call("crane/Crane/shifted", (0.0, 0.0))
        with pytest.raises(ValueError, match="is a topic"):
            sim.call("crane/News/said")
