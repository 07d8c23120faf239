"""Inertial units, sensors of touch and the truth, against what can be computed by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.world import World

HALL = """\
<innerModel>
  <plane id="floor" size="20000,10,20000" py="-5"/>
  <differentialrobot id="base">
    <plane id="body" size="300,300,300" py="150"/>
    <translation id="front" tz="300" ty="100"><imu id="imu"/></translation>
    <rotation id="tilted" rx="0.3"><imu id="slanted"/></rotation>
    <joint id="arm" ty="400" axis="x"><transform id="hand" ty="500"><imu id="wrist"/></transform></joint>
    <touchsensor id="bumper" type="bumper"><plane id="fender" size="300,50,100" py="100" pz="150"/></touchsensor>
  </differentialrobot>
  <transform id="ball" ty="5000" tx="3000" engine="bullet"><imu id="thrown"/></transform>
  <touchsensor id="scale" ny="1" max="100"><plane id="dish" size="500,20,500" px="-2000" py="90"/></touchsensor>
  <transform id="box" tx="-2000" ty="201" engine="bullet" mass="2"><plane id="boxes" size="200,200,200"/></transform>
  <plane id="post" size="200,1000,200" pz="1500" py="500" collide="1"/>
</innerModel>
"""


def world(folder: Path, text: str = HALL, **options: object) -> World:
    path = folder / "hall.xml"
    path.write_text(text)
    return World(Tree.read(path), hold=0, **options)  # type: ignore[arg-type]


@pytest.fixture(params=[False, True], ids=["kinematic", "physics"])
def hall(request: pytest.FixtureRequest, tmp_path: Path) -> World:
    return world(tmp_path, physics=request.param)


# Inertial units.


def test_no_number_of_what_rests_is_minus_0() -> None:
    tree = Tree()
    tree.add("root", "differentialrobot", "base")
    tree.add("base", "imu", "unit")
    world = World(tree)
    inertial, truth = world.inertial("unit"), world.truth("base")
    angles = (inertial.roll, inertial.pitch, inertial.yaw)
    told = (*truth[:4], world.poses()[:, :3, 3], *inertial[:3], np.array(angles))
    assert not any(np.signbit(each).any() for each in told)


def test_at_rest_a_unit_feels_what_holds_it_up(hall: World) -> None:
    hall.step(5)
    assert hall.inertial("imu").acceleration == pytest.approx((0, 9.81, 0), abs=1e-6)
    leaning = 9.81 * np.array((0, math.cos(0.3), -math.sin(0.3)))
    assert hall.inertial("slanted").acceleration == pytest.approx(leaning, abs=1e-6)


def test_in_free_fall_it_feels_nothing(tmp_path: Path) -> None:
    hall = world(tmp_path, physics=True)
    hall.step(20)
    assert hall.inertial("thrown").acceleration == pytest.approx((0, 0, 0), abs=1e-9)


def test_robocomps_sign_is_the_other_one(tmp_path: Path) -> None:
    hall = world(tmp_path, compat="robocomp")
    hall.step()
    assert hall.inertial("imu").acceleration == pytest.approx((0, -9.81, 0))


def test_a_turn_to_the_right_is_positive_and_pulls_to_the_middle(hall: World) -> None:
    hall.drive("base", turn=2.0)
    hall.step(100)
    read = hall.inertial("imu")
    assert read.gyroscope == pytest.approx((0, 2, 0), abs=0.01)
    assert read.acceleration == pytest.approx((0, 9.81, -0.3 * 4), abs=0.03)


def test_it_feels_that_a_robot_goes_faster(tmp_path: Path) -> None:
    hall = world(tmp_path)
    for speed in range(0, 1000, 10):
        hall.drive("base", ahead=speed)
        hall.step()
    assert hall.inertial("imu").acceleration == pytest.approx((0, 9.81, 2.0))


def test_the_gyroscope_of_a_hand_turns_as_its_joint(hall: World) -> None:
    hall.move_joint("arm", 3.0, speed=1.5)
    hall.step(100)
    assert hall.inertial("wrist").gyroscope == pytest.approx((1.5, 0, 0), abs=0.01)


def test_the_magnetic_field_is_ahead_in_the_world(hall: World) -> None:
    hall.drive("base", turn=math.pi / 2)
    hall.step(200)
    assert hall.inertial("imu").magnetic == pytest.approx((-1, 0, 0), abs=0.05)


@pytest.mark.parametrize("turn", [0.5, 2.0, -3.0])
def test_roll_pitch_and_yaw(turn: float, tmp_path: Path) -> None:
    hall = world(tmp_path)
    hall.drive("base", turn=turn)
    hall.step(200)
    read = hall.inertial("slanted")
    assert (read.roll, read.pitch, read.yaw) == pytest.approx((0, 0.3, turn))
    hall.reset_imu("slanted")
    assert hall.inertial("slanted").yaw == pytest.approx(0)
    hall.step(50)
    assert hall.inertial("slanted").yaw == pytest.approx(turn / 4)
    assert hall.inertial("imu").yaw == pytest.approx(math.remainder(1.25 * turn, math.tau))


def test_the_noise_of_a_unit_has_its_deviation(tmp_path: Path) -> None:
    hall = world(tmp_path)
    hall.set_noise("imu", 0.2)
    errors = []
    for _ in range(1000):
        hall.step()
        read = hall.inertial("imu")
        errors.append((*read.acceleration - (0, 9.81, 0), *read.gyroscope))
    assert np.std(errors, axis=0) == pytest.approx(np.full(6, 0.2), rel=0.1)


# Touch.


def test_a_scale_weighs(tmp_path: Path) -> None:
    hall = world(tmp_path, physics=True)
    assert hall.touch("scale") == 0
    hall.step(400)
    assert hall.touch("scale") == pytest.approx(2 * 9.81, rel=1e-3)
    hall = world(tmp_path, HALL.replace('max="100"', 'max="10"'), physics=True)
    hall.step(400)
    assert hall.touch("scale") == 10


@pytest.mark.parametrize(("normal", "force"), [('nx="1"', 0.0), ('ny="-1"', -19.62), ("", 19.62)])
def test_only_the_part_along_the_normal_counts(normal: str, force: float, tmp_path: Path) -> None:
    hall = world(tmp_path, HALL.replace('ny="1"', normal), physics=True)
    hall.step(400)
    assert hall.touch("scale") == pytest.approx(force, rel=1e-3, abs=0.01)


def test_a_bumper_tells_that_it_touches(hall: World) -> None:
    hall.drive("base", ahead=500)
    told = []
    for _ in range(14):
        hall.step(40)
        told.append((hall.touch("bumper"), hall.matrix("base")[2, 3]))
    for value, place in told:
        if place < 1190:
            assert value == 0
        if place > 1201:
            assert value == 1
    assert told[-1][0] == 1


def test_with_physics_off_overlap_is_told(tmp_path: Path) -> None:
    hall = world(tmp_path)
    assert hall.touch("scale") == 0
    hall = world(tmp_path, HALL.replace('ty="201"', 'ty="199"'))
    assert hall.touch("scale") == 1


# The truth.


def test_the_truth_has_poses_and_speeds_of_any_node(hall: World) -> None:
    hall.drive("base", ahead=300, turn=0.5)
    hall.move_joint("arm", 3.0, speed=1.0)
    hall.step(100)
    before = hall.matrix("hand")
    hall.step()
    told, after = hall.truth("hand"), hall.matrix("hand")
    assert told.position == pytest.approx(after[:3, 3] / 1000)
    assert told.velocity == pytest.approx((after - before)[:3, 3] / 5, abs=0.005)
    turned = after[:3, :3] @ before[:3, :3].T
    rate = np.array((turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1])) / 0.01
    assert told.turning == pytest.approx(rate, abs=0.005)
    assert hall.truth("base").turning == pytest.approx((0, 0.5, 0), abs=0.005)
    assert hall.truth("base").angles == pytest.approx((0, math.atan2(hall.matrix("base")[0, 2], 1), 0), abs=0.05)
    assert hall.truth("post").velocity == pytest.approx((0, 0, 0))


def test_what_is_measured_is_part_of_a_copy(hall: World) -> None:
    hall.drive("base", ahead=300, turn=0.5)
    hall.step(30)
    hall.reset_imu("imu")
    copy = hall.copy()
    for each in (hall, copy):
        each.drive("base", ahead=-300)
        each.step(3)
    assert copy.digest() == hall.digest()
    for one, other in zip(copy.inertial("imu")[:3], hall.inertial("imu")[:3], strict=True):
        assert np.array_equal(np.asarray(one), np.asarray(other))


def test_wrong_names_and_modes_are_refused(tmp_path: Path) -> None:
    hall = world(tmp_path)
    with pytest.raises(ValueError, match="unknown imu `imus`; did you mean `imu`"):
        hall.inertial("imus")
    with pytest.raises(ValueError, match="unknown sensor of touch `imu`"):
        hall.touch("imu")
    with pytest.raises(ValueError, match="compat='webots': it is `robocomp`, or nothing"):
        world(tmp_path, compat="webots")
