"""How joints move."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.joints import At, Motor, To, moved
from robocomp_py.sim.world import World

ARM = """\
<innerModel>
  <joint id="shoulder" axis="x" min="-1" max="1">
    <joint id="elbow" tz="300"><prismaticjoint id="slide" axis="y" min="-20" max="80"/></joint>
  </joint>
</innerModel>
"""


@pytest.fixture
def arm(tmp_path: Path) -> World:
    (tmp_path / "arm.xml").write_text(ARM)
    return World(Tree.read(tmp_path / "arm.xml"))


def test_a_joint_gains_speed_at_its_acceleration(arm: World) -> None:
    arm.drive_joint("elbow", 2.0, acceleration=4.0)
    arm.step(50)
    assert arm.joint_speed("elbow") == pytest.approx(1.0)
    assert arm.position("elbow") == pytest.approx(4.0 * 0.25**2 / 2)
    arm.step(150)
    assert arm.joint_speed("elbow") == 2.0
    assert arm.position("elbow") == pytest.approx(4.0 * 0.5**2 / 2 + 2.0 * 0.5)
    arm.drive_joint("elbow", 0.0, acceleration=4.0)
    arm.step(200)
    assert arm.joint_speed("elbow") == 0.0
    assert arm.position("elbow") == pytest.approx(2.0)


def test_without_an_acceleration_it_has_its_speed_at_once(arm: World) -> None:
    arm.drive_joint("slide", 40.0)
    arm.step(100)
    assert (arm.position("slide"), arm.joint_speed("slide")) == pytest.approx((20, 40))


def test_it_stops_at_its_limits_and_leaves_them(arm: World) -> None:
    arm.drive_joint("shoulder", -3.0)
    arm.step(100)
    assert (arm.position("shoulder"), arm.joint_speed("shoulder")) == (-1.0, 0.0)
    arm.drive_joint("shoulder", 1.0, acceleration=2.0)
    arm.step(100)
    assert arm.position("shoulder") == pytest.approx(-0.75)
    arm.move_joint("shoulder", 9.0, speed=10.0)
    arm.step(100)
    assert arm.position("shoulder") == 1.0


def test_a_joint_that_is_braked_at_a_limit_turns_round(arm: World) -> None:
    arm.drive_joint("shoulder", -4.0)
    arm.step(45)
    arm.drive_joint("shoulder", 1.0, acceleration=1.0)
    arm.step(100)
    assert arm.joint_speed("shoulder") > 0.0
    assert arm.position("shoulder") > -1.0


def test_what_a_joint_is_told_last_counts(arm: World) -> None:
    arm.move_joint("elbow", 1.0, speed=1.0)
    arm.step(50)
    arm.drive_joint("elbow", -1.0)
    arm.step(50)
    assert arm.position("elbow") == pytest.approx(0.0)
    arm.move_joint("elbow", 0.5)
    arm.step(50)
    assert (arm.position("elbow"), arm.joint_speed("elbow")) == (0.5, 0.0)


def test_a_joint_without_limits_stops_where_messages_cannot_carry_its_place(arm: World) -> None:
    arm.drive_joint("elbow", 1e9)
    arm.step(300)
    assert (arm.position("elbow"), arm.joint_speed("elbow")) == (1e9, 0.0)


@pytest.mark.parametrize("number", [math.nan, math.inf, 3e38])
def test_of_several_goals_all_are_taken_or_none(number: float, arm: World) -> None:
    before = arm.digest()
    with pytest.raises(ValueError, match="is no position"):
        arm.move_joints({"elbow": (1.0, 0.0), "slide": (number, 1.0)})
    with pytest.raises(ValueError, match="is no speed"):
        arm.drive_joints({"elbow": (1.0, 0.0), "slide": (1.0, number)})
    with pytest.raises(InnerModelError, match="unknown joint `elbo`; did you mean `elbow`"):
        arm.drive_joints({"slide": (1.0, 0.0), "elbo": (1.0, 0.0)})
    assert arm.digest() == before


SPEEDS = st.floats(-100, 100)
GOALS = st.one_of(st.builds(To, st.floats(-1, 2), st.floats(1e-3, 100)), st.builds(At, SPEEDS, st.floats(0, 100)))


@given(st.floats(-1, 2), GOALS, st.integers(1, 50))
def test_a_motor_stays_within_its_limits_and_its_speed(place: float, goal: To | At, ticks: int) -> None:
    motor = Motor(place, 0.0, goal)
    for _ in range(ticks):
        before, motor = motor, moved(motor, 0.005, -1.0, 2.0)
        assert -1.0 <= motor.position <= 2.0
        assert abs(motor.position - before.position) <= abs(goal.speed) * 0.005 + 1e-12
        if isinstance(goal, At) and goal.acceleration and motor.position not in (-1.0, 2.0):
            assert abs(motor.speed - before.speed) <= goal.acceleration * 0.005 + 1e-9
