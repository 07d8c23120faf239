from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from wander.generic.RoboCompGenericBase import HardwareFailedException, TBaseState
from wander.generic.RoboCompLaser import TData
from wander.specificworker import SpecificWorker

from robocomp_py.errors import RemoteFailure
from robocomp_py.testing.components import ComponentTest

FAST = {"component.period": 0.002}
SPEED = "differentialrobot.setSpeedBase"
STOP = "differentialrobot.stopBase"


def scan(*, left: float = 5.0, ahead: float = 5.0, right: float = 5.0) -> list[TData]:
    """Walls so many m to the left, ahead and to the right."""

    def reach(angle: float) -> float:
        aside, along = math.sin(angle), math.cos(angle)
        walls = [right / aside if aside > 0.01 else 5.0, left / -aside if aside < -0.01 else 5.0]
        walls += [ahead / along] if along > 0.01 else []
        return min(5.0, *walls)

    return [TData(angle, reach(angle) * 1000) for angle in (math.radians(degrees) for degrees in range(-135, 136, 3))]


def at(x: float = 0.0, z: float = 0.0, alpha: float = 0.0) -> TBaseState:
    return TBaseState(correctedX=x * 1000, correctedZ=z * 1000, correctedAlpha=alpha)


def wander(seen: Callable[[], Any] = lambda: (scan(), at()), **config: Any) -> ComponentTest:
    settings = {**FAST, **{f"params.{key}": value for key, value in config.items()}}
    return ComponentTest(SpecificWorker, settings, laser={"getLaserAndBStateData": seen}, virtual=True)


def explore(component: ComponentTest, seen: list[TData]) -> tuple[float, float]:
    """What it does about a scan."""
    before = len(component.received(SPEED))
    component.send("LaserPub.pushLaserData", seen)
    component.wait_for(lambda: len(component.received(SPEED)) > before)
    return component.received(SPEED)[-1]


def test_without_a_command_it_does_not_drive() -> None:
    with wander() as component:
        component.send("LaserPub.pushLaserData", scan())
        component.wait_for_computes(5)
    assert component.fine
    assert not component.received(SPEED)


def test_it_explores_at_once_if_so_configured() -> None:
    with wander(explores=True) as component:
        adv, _ = explore(component, scan(left=0.5))
    assert adv > 500


def test_a_command_to_go_anywhere_starts_an_exploration() -> None:
    with wander() as component:
        component.call("GotoPoint.go", "anywhere", 0.0, 0.0, 0.0)
        adv, rot = explore(component, scan(left=0.5))
        assert adv > 500
        assert abs(rot) < 0.8
        assert not component.call("GotoPoint.atTarget")


def test_it_turns_away_from_a_wall_and_does_not_drive_into_it() -> None:
    with wander() as component:
        component.call("GotoPoint.go", "anywhere", 0.0, 0.0, 0.0)
        adv, rot = explore(component, scan(left=0.5, ahead=0.45))
    assert adv == pytest.approx(0.0)
    assert rot > 1.0


def test_every_exploration_has_the_other_hand_at_the_wall() -> None:
    with wander() as component:
        turns = []
        for _ in range(4):
            component.call("GotoPoint.go", "anywhere", 0.0, 0.0, 0.0)
            turns.append(explore(component, scan(ahead=0.6))[1] > 0)
    assert turns == [True, False, True, False]


def test_a_scan_is_used_once() -> None:
    with wander() as component:
        component.call("GotoPoint.go", "anywhere", 0.0, 0.0, 0.0)
        explore(component, scan())
        component.wait_for_computes(5)
    assert len(component.received(SPEED)) == 1


def test_stop_stops_the_base_and_keeps_it_still() -> None:
    with wander() as component:
        component.call("GotoPoint.turn", 0.5)
        component.wait_for(lambda: component.received(SPEED))
        component.call("GotoPoint.stop")
        component.wait_for(lambda: component.received(STOP))
        driven = len(component.received(SPEED))
        component.wait_for_computes(5)
    assert len(component.received(SPEED)) == driven
    assert len(component.received(STOP)) == 1


def test_turning_is_said_again_and_again() -> None:
    with wander() as component:
        component.call("GotoPoint.turn", 0.5)
        component.wait_for(lambda: len(component.received(SPEED)) >= 3)
    assert set(component.received(SPEED)) == {(0.0, 0.5)}


def test_it_goes_straight_to_a_place_that_is_in_sight() -> None:
    with wander(lambda: (scan(), at(x=1.0, z=1.0))) as component:
        component.call("GotoPoint.go", "", 1000.0, 3500.0, 0.0)
        component.wait_for(lambda: component.received(SPEED))
        assert not component.call("GotoPoint.atTarget")
    assert component.received(SPEED)[0] == pytest.approx((1200.0, 0.0))


def test_it_first_turns_to_a_place_that_is_behind() -> None:
    with wander(lambda: (scan(), at(x=1.0, z=1.0))) as component:
        component.call("GotoPoint.go", "", 0.0, 1000.0, 0.0)
        component.wait_for(lambda: component.received(SPEED))
    adv, rot = component.received(SPEED)[0]
    assert adv == 0.0
    assert rot < 0


def test_it_slows_down_near_the_place() -> None:
    with wander(lambda: (scan(), at(z=0.7))) as component:
        component.call("GotoPoint.go", "", 0.0, 1000.0, 0.0)
        component.wait_for(lambda: component.received(SPEED))
    assert component.received(SPEED)[0][0] == pytest.approx(300, abs=1)


def test_at_the_target_it_turns_to_the_commanded_heading() -> None:
    alpha = 0.0
    with wander(lambda: (scan(), at(x=2.0, z=1.0, alpha=alpha))) as component:
        component.call("GotoPoint.go", "", 2000.0, 1000.0, 1.5)
        component.wait_for(lambda: component.received(SPEED))
        assert not component.call("GotoPoint.atTarget")
        assert component.received(SPEED)[-1][0] == 0.0
        assert component.received(SPEED)[-1][1] > 0
        alpha = 1.5
        component.wait_for(lambda: component.call("GotoPoint.atTarget"))
        component.wait_for(lambda: component.received(STOP))


def test_a_new_place_is_not_yet_reached() -> None:
    with wander(lambda: (scan(), at())) as component:
        component.call("GotoPoint.go", "", 0.0, 0.0, 0.0)
        component.wait_for(lambda: component.call("GotoPoint.atTarget"))
        component.call("GotoPoint.go", "", 5000.0, 0.0, 0.0)
        assert not component.call("GotoPoint.atTarget")


def test_a_command_during_the_wait_for_a_scan_counts() -> None:
    def stopped_meanwhile() -> tuple[list[TData], TBaseState]:
        component.call("GotoPoint.stop")
        return scan(), at()

    with wander(stopped_meanwhile) as component:
        component.call("GotoPoint.go", "", 5000.0, 0.0, 0.0)
        component.wait_for_computes(5)
    assert component.fine
    assert not component.received(SPEED)


def nowhere(operation: str, *arguments: Any) -> None:
    """It refuses a command, and neither moves nor ends."""
    with wander() as component:
        with pytest.raises(RemoteFailure, match="must be finite"):
            component.call(operation, *arguments)
        component.send("LaserPub.pushLaserData", scan())
        component.wait_for_computes(5)
    assert component.fine
    assert not component.received(SPEED)


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_a_place_that_is_no_place_is_refused(wrong: float) -> None:
    nowhere("GotoPoint.go", "", wrong, 0.0, 0.0)
    nowhere("GotoPoint.go", "", 0.0, wrong, 0.0)
    nowhere("GotoPoint.go", "", 0.0, 0.0, wrong)


@pytest.mark.parametrize("wrong", [math.nan, -math.inf])
def test_a_turn_at_no_speed_is_refused(wrong: float) -> None:
    nowhere("GotoPoint.turn", wrong)


BLIND = [[], [TData(0.0, math.nan)], [TData(math.inf, 1000.0)], [TData(math.nan, math.inf)]]


@pytest.mark.parametrize("blind", BLIND)
def test_without_a_measure_an_exploration_stands_still_until_the_next_scan(blind: list[TData]) -> None:
    with wander() as component:
        component.call("GotoPoint.go", "anywhere", 0.0, 0.0, 0.0)
        assert explore(component, scan())[0] > 0
        component.send("LaserPub.pushLaserData", blind)
        component.wait_for(lambda: component.received(STOP))
        assert explore(component, scan())[0] > 0
    assert component.fine


def test_measures_that_are_no_numbers_are_ignored() -> None:
    measures = scan(ahead=0.6)
    measures[20:30] = [TData(measure.angle, math.nan) for measure in measures[20:30]]
    with wander() as component:
        component.call("GotoPoint.go", "anywhere", 0.0, 0.0, 0.0)
        assert all(map(math.isfinite, explore(component, measures)))
    assert component.fine


def test_a_laser_that_sees_one_side_only_is_enough() -> None:
    with wander() as component:
        for _ in range(2):
            component.call("GotoPoint.go", "anywhere", 0.0, 0.0, 0.0)
            assert explore(component, [TData(1.0, 5000.0)])[0] > 0
    assert component.fine


@pytest.mark.parametrize("seen", [(scan(), at(x=math.nan)), (scan(), at(alpha=math.inf)), ([], at())])
def test_without_a_scan_or_a_pose_it_stands_still_on_its_way(seen: tuple[list[TData], TBaseState]) -> None:
    now = scan(), at()
    with wander(lambda: now) as component:
        component.call("GotoPoint.go", "", 0.0, 3000.0, 0.0)
        component.wait_for(lambda: component.received(SPEED))
        now = seen
        component.wait_for(lambda: component.received(STOP))
        driven = len(component.received(SPEED))
        component.wait_for_computes(3)
        assert len(component.received(SPEED)) == driven
        now = scan(), at()
        component.wait_for(lambda: len(component.received(SPEED)) > driven)
    assert component.fine


def test_a_base_that_fails_is_stopped_and_driven_again_later(caplog: pytest.LogCaptureFixture) -> None:
    fails = True

    def may_fail(*speeds: float) -> None:
        if fails:
            raise HardwareFailedException("the motor is too hot")

    base = {"setSpeedBase": may_fail, "stopBase": may_fail}
    with ComponentTest(SpecificWorker, FAST, differentialrobot=base, virtual=True) as component:
        component.call("GotoPoint.turn", 0.5)
        component.wait_for(lambda: len(component.received(STOP)) >= 3)
        fails, tried = False, len(component.received(SPEED))
        component.wait_for(lambda: len(component.received(SPEED)) >= tried + 3)
    assert component.fine
    assert caplog.text.count("the base fails: ") == 1
    assert "the motor is too hot" in caplog.text
