"""What a robot feels and where it truly is, as clients of a simulating component see it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.testing.components import ComponentTest, load_component

SCENE = """\
<innerModel>
  <transform id="world">
    <omnirobot id="chair" tx="1000" ry="0.5">
      <imu id="gyro"/>
      <touchsensor id="bumper" type="bumper"><plane id="front" pz="200" size="100,100,20"/></touchsensor>
    </omnirobot>
    <transform id="stand" tz="3000"><plane id="wall" size="9000,2000,10"/></transform>
  </transform>
</innerModel>
"""


@pytest.fixture(scope="module")
def component(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ComponentTest]:
    folder = tmp_path_factory.mktemp("sensors")
    (folder / "room.xml").write_text(SCENE)
    assert rc(["sim", "new", str(folder / "room.xml"), "-o", str(folder / "house")]) == 0
    with ComponentTest(load_component(folder / "house"), virtual=True) as component:
        yield component
    assert component.fine


@pytest.fixture
def house(component: ComponentTest) -> Any:
    component.call("Simulation.pause")
    component.call("Simulation.reset", 1)
    return component.worker


def test_an_inertial_unit_is_asked(house: Any) -> None:
    imu = house.imu["gyro"]
    assert imu.getAcceleration().YAcc == pytest.approx(9.81)
    assert imu.getOrientation().Yaw == pytest.approx(0.5)
    imu.resetImu()
    house.omnirobot["chair"].setSpeedBase(0.0, 0.0, 0.4)
    house.world.step(100)
    data = imu.getDataImu()
    assert (data.gyro.YGyr, data.rot.Yaw) == pytest.approx((0.4, 0.2))
    assert imu.getAngularVel() == data.gyro
    assert imu.getMagneticFields() == data.mag
    assert data.mag.XMag**2 + data.mag.YMag**2 + data.mag.ZMag**2 == pytest.approx(1)


def test_a_bumper_is_asked(house: Any) -> None:
    assert house.touchsensor["bumper"].getValues()["bumper"].value == 0
    house.world.set_physics(False)
    house.omnirobot["chair"].setSpeedBase(0.0, 3575.0, 0.0)
    house.world.step(180)
    state = house.touchsensor["bumper"].getValues()["bumper"]
    assert (state.name, state.value) == ("bumper", 1)


def test_the_truth_is_in_metres_and_has_speeds(house: Any) -> None:
    house.omnirobot["chair"].setSpeedBase(100.0, 200.0, 0.0)
    house.world.step(100)
    house.differentialrobot["chair"].setOdometerPose(5, 6, 0.7)
    pose = house.fullposeestimation["chair"].getFullPoseEuler()
    assert pose.source == "chair"
    assert (pose.ry, pose.adv, pose.side) == pytest.approx((0.5, 0.2, 0.1))
    assert (pose.x - 1.0, pose.z) == pytest.approx((0.5 * pose.vx, 0.5 * pose.vz))
    matrix = house.fullposeestimation["chair"].getFullPoseMatrix()
    assert (matrix.m03, matrix.m23, matrix.m33) == pytest.approx((pose.x, pose.z, 1))
    with pytest.raises(ValueError, match="setPose moves a base"):
        house.fullposeestimation["chair"].setInitialPose(0, 0, 0, 0, 0, 0)


def test_sensors_are_published(component: ComponentTest, house: Any) -> None:
    component.wait_for(lambda: component.received("imupub.publish"))
    component.wait_for(lambda: component.received("fullposeestimationpub.newFullPose"))
    [(imu, *_)] = component.received("imupub.publish")[-1:]
    assert imu.acc.YAcc == pytest.approx(9.81, abs=1)


def test_conventions_of_robocomp_can_be_had(tmp_path: Path) -> None:
    """The sign of accelerations; and a joint that is provided loses its offset, since it is moved to its home."""
    joint = '<joint id="pan" tz="100"><translation id="lens" ty="50"/></joint>'
    (tmp_path / "room.xml").write_text(SCENE.replace('<imu id="gyro"/>', f'<imu id="gyro"/>{joint}'))
    assert rc(["sim", "new", str(tmp_path / "room.xml"), "-o", str(tmp_path / "house")]) == 0
    made = load_component(tmp_path / "house")
    for compat, sign, offset in (("none", 1.0, 100.0), ("robocomp", -1.0, 0.0)):
        with ComponentTest(made, {"params.compat": compat}, virtual=True) as house:
            assert house.worker.imu["gyro"].getAcceleration().YAcc == pytest.approx(9.81 * sign)
            assert house.worker.world.matrix("lens", "chair")[:3, 3] == pytest.approx((0, 50, offset), abs=1e-6)
            assert house.worker.world.tree.matrix("chair", "lens")[:3, 3] == pytest.approx((0, 50, offset))
        assert house.fine
