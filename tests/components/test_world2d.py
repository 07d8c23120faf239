from __future__ import annotations

import math
from pathlib import Path

import pytest
from world2d.generic.RoboCompBatteryStatus import BatteryStates
from world2d.generic.RoboCompGenericBase import HardwareFailedException, TBaseState
from world2d.specificworker import SpecificWorker

from robocomp_py.testing.components import ComponentTest

FAST = {"component.period": 0.002}
STATE = "DifferentialRobot.getBaseState"
SPEED = "DifferentialRobot.setSpeedBase"


def world(**config: float | str) -> ComponentTest:
    return ComponentTest(
        SpecificWorker, {**FAST, **{f"params.{key}": value for key, value in config.items()}}, virtual=True
    )


def test_every_compute_tells_scan_pose_and_battery() -> None:
    with world(beams=31) as component:
        component.wait_for_computes(3)
        component.wait_for(lambda: len(component.received("batterystatuspub.pushBatteryState")) >= 3)
    assert component.fine
    (scan,) = component.received("laserpub.pushLaserData")[0]
    (pose,) = component.received("differentialrobotpub.pushBaseState")[0]
    assert len(scan) == 31
    assert scan[0].angle == pytest.approx(-math.radians(135))
    assert (pose.x, pose.z) == (pytest.approx(600), pytest.approx(4200))


def test_driving_moves_it_by_millimetres() -> None:
    with world() as component:
        component.call(SPEED, 500.0, 0.0)
        component.wait_for(lambda: component.call(STATE).z > 4300)
        assert component.call(STATE).x == pytest.approx(600, abs=1)


def test_it_stops_a_second_of_its_own_time_after_the_last_command() -> None:
    with world(step=0.25) as component:
        component.call(SPEED, 0.0, 1.0)
        component.wait_for(lambda: not component.call(STATE).isMoving)
        assert component.call(STATE).alpha == pytest.approx(1.0)


def test_stop_stops_it() -> None:
    with world(step=0.001) as component:
        component.call(SPEED, 100.0, 1.0)
        component.call("DifferentialRobot.stopBase")
        assert not component.call(STATE).isMoving


def test_asked_for_a_scan_it_gives_the_last_one_and_the_pose_that_belongs_to_it() -> None:
    with world(noise=0) as component:
        scan, state = component.call("Laser.getLaserAndBStateData")
        ahead = scan[len(scan) // 2]
        assert ahead.angle == pytest.approx(0.0)
        assert ahead.dist == pytest.approx(8000 - state.z)


def test_the_laser_tells_how_it_is_set() -> None:
    with world(beams=91) as component:
        laser = component.call("Laser.getLaserConfData")
    assert (laser.maxMeasures, laser.maxDegrees, laser.angleRes) == (91, 270, 3.0)


def test_the_same_seed_gives_the_same_noise() -> None:
    def first_scan(seed: int) -> list[float]:
        with world(seed=seed) as component:
            component.wait_for(lambda: component.received("laserpub.pushLaserData"))
        return [measure.dist for measure in component.received("laserpub.pushLaserData")[0][0]]

    assert first_scan(5) == first_scan(5)
    assert first_scan(5) != first_scan(6)


def test_an_odometer_can_be_set_and_corrected() -> None:
    with world() as component:
        component.call("DifferentialRobot.resetOdometer")
        assert component.call("DifferentialRobot.getBasePose") == (0, 0, 0.0)
        component.call("DifferentialRobot.setOdometerPose", 100, 200, 0.5)
        component.call("DifferentialRobot.correctOdometer", 110, 210, 0.25)
        state = component.call(STATE)
        assert (state.x, state.z, state.alpha) == pytest.approx((100, 200, 0.5))
        assert (state.correctedX, state.correctedZ, state.correctedAlpha) == pytest.approx((110, 210, 0.25))
        component.call("DifferentialRobot.setOdometer", TBaseState(x=1, z=2, correctedX=3, correctedZ=4))
        state = component.call(STATE)
        assert (state.x, state.z, state.correctedX, state.correctedZ) == pytest.approx((1, 2, 3, 4))


@pytest.mark.parametrize("speeds", [(math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0), (0.0, -math.inf)])
def test_speeds_that_are_no_numbers_are_refused_and_the_old_ones_remain(speeds: tuple[float, float]) -> None:
    with world(step=0.001) as component:
        component.call(SPEED, 100.0, 0.5)
        with pytest.raises(HardwareFailedException, match="must be finite"):
            component.call(SPEED, *speeds)
        component.wait_for_computes(3)
        assert component.call(STATE).advVz == pytest.approx(100)
        assert component.call(STATE).rotV == pytest.approx(0.5)
    assert component.fine


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 3e38])
def test_an_impossible_pose_is_refused_and_the_old_one_remains(wrong: float) -> None:
    heading = math.inf if wrong == 3e38 else wrong
    refused = [
        ("setOdometerPose", 1, 2, heading),
        ("correctOdometer", 1, 2, heading),
        *(("setOdometer", TBaseState(**{name: wrong})) for name in ("x", "z", "correctedX", "correctedZ")),
        *(("setOdometer", TBaseState(**{name: heading})) for name in ("alpha", "correctedAlpha")),
    ]
    with world() as component:
        before = component.call(STATE)
        for operation, *arguments in refused:
            with pytest.raises(HardwareFailedException, match="not a pose"):
                component.call(f"DifferentialRobot.{operation}", *arguments)
        component.wait_for_computes(3)
        assert component.call(STATE) == before
        assert component.call("DifferentialRobot.getBasePose")
    assert component.fine


def test_the_battery_is_disconnected_away_from_the_charger() -> None:
    with world(battery=40) as component:
        battery = component.call("BatteryStatus.getBatteryState")
    assert battery.state is BatteryStates.Disconnected
    assert 0 < battery.percentage <= 40
    assert battery.power <= 0


def test_the_battery_is_charged_at_the_charger(tmp_path: Path) -> None:
    with world(battery=40, map=house_with(tmp_path, start=(0.8, 2.6, 0.0))) as component:
        component.wait_for(lambda: component.call("BatteryStatus.getBatteryState").state is BatteryStates.Charged)
        assert component.call("BatteryStatus.getBatteryState").percentage == 100


def test_without_battery_it_does_not_move() -> None:
    with world(battery=0) as component:
        component.call(SPEED, 500.0, 1.0)
        component.wait_for_computes(3)
        assert not component.call(STATE).isMoving
        assert component.call(STATE).z == pytest.approx(4200)


def test_at_the_end_it_draws_what_happened(tmp_path: Path) -> None:
    picture = tmp_path / "story.svg"
    with world(picture=str(picture)) as component:
        component.call(SPEED, 500.0, 1.0)
        component.wait_for_computes(10)
    assert component.fine
    assert picture.read_text().startswith("<svg")


def house_with(folder: Path, *, start: tuple[float, float, float]) -> str:
    text = (Path(__file__).parents[2] / "components" / "house.toml").read_text()
    lines = [f"start = {list(start)}" if line.startswith("start") else line for line in text.splitlines()]
    path = folder / "house.toml"
    path.write_text("\n".join(lines))
    return str(path)
