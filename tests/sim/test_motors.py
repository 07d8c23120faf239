"""The joints of a scene as JointMotor: what clients of a simulating component see."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator
from typing import Any

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.testing.components import ComponentTest, load_component

SCENE = """\
<innerModel>
  <transform id="world">
    <joint id="pan" port="10067" axis="y" min="-1" max="1" home="0.25">
      <joint id="tilt" port="10067" axis="x" home="9" max="0.5"/>
    </joint>
    <prismaticjoint id="lift" axis="y" min="40" max="300" position="60"/>
  </transform>
</innerModel>
"""


@pytest.fixture(scope="module")
def component(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ComponentTest]:
    folder = tmp_path_factory.mktemp("motors")
    scene = folder / "head.xml"
    scene.write_text(SCENE)
    assert rc(["sim", "new", str(scene), "-o", str(folder / "head")]) == 0
    with ComponentTest(load_component(folder / "head"), virtual=True) as component:
        yield component
    assert component.fine


@pytest.fixture
def head(component: ComponentTest) -> ComponentTest:
    for motors in component.worker.jointmotor.values():
        motors.setSyncZeroPos()
    return component


def call(head: ComponentTest, operation: str, *arguments: object, instance: str = "joints10067") -> Any:
    return getattr(head.worker.jointmotor[instance], operation)(*arguments)


def made(head: ComponentTest, name: str, *values: object) -> Any:
    """A struct of the component's own classes."""
    package = type(head.worker).__module__.rpartition(".")[0]
    return getattr(importlib.import_module(f"{package}.generic.RoboCompJointMotor"), name)(*values)


def test_all_joints_with_one_port_are_one_instance_and_begin_at_home(head: ComponentTest) -> None:
    assert list(head.worker.jointmotor) == list(head.worker.jointmotorpub) == ["joints10067", "joints"]
    states = call(head, "getAllMotorState")
    assert {name: state.pos for name, state in states.items()} == {"pan": 0.25, "tilt": 0.5}
    assert call(head, "getMotorState", "lift", instance="joints").pos == pytest.approx(40)
    pan, tilt = call(head, "getAllMotorParams")
    assert (pan.name, pan.minPos, pan.maxPos, pan.zeroPos) == ("pan", -1, 1, 0.25)
    assert (tilt.minPos, tilt.maxPos) == (-math.inf, 0.5)
    bus = call(head, "getBusParams")
    assert (bus.device, bus.numMotors, bus.basicPeriod) == ("joints10067", 2, 5)


def test_a_motor_goes_to_its_goal_at_once_or_at_its_speed(head: ComponentTest) -> None:
    call(head, "setPosition", made(head, "MotorGoalPosition", "pan", 7.0, 0.0))
    assert call(head, "getMotorState", "pan").pos == 1.0
    call(head, "setPosition", made(head, "MotorGoalPosition", "pan", 0.0, 0.5))
    began = head.worker.world.time
    head.wait_for_computes(11)
    passed = head.worker.world.time - began
    state = call(head, "getMotorState", "pan")
    assert state.pos == pytest.approx(1 - 0.5 * passed)
    assert (state.vel, state.isMoving) == (-0.5, True)
    assert float(state.timeStamp) == pytest.approx(head.worker.world.time)
    call(head, "setZeroPos", "pan")
    assert call(head, "getMotorStateMap", ["pan"])["pan"].pos == 0.25


@pytest.mark.parametrize("physics", [False, True])
def test_a_motor_moves_from_its_goal_on_until_it_is_there(physics: bool, head: ComponentTest) -> None:
    world = head.worker.world
    world.set_physics(physics)
    call(head, "setPosition", made(head, "MotorGoalPosition", "pan", 0.5, 0.5))
    assert call(head, "getMotorState", "pan").isMoving
    world.step(20)
    assert call(head, "getMotorState", "pan").isMoving
    world.step(400)
    state = call(head, "getMotorState", "pan")
    assert (state.pos, state.isMoving) == (pytest.approx(0.5, abs=1e-4), False)
    world.set_physics(False)


def test_a_motor_heeds_its_acceleration(head: ComponentTest) -> None:
    call(head, "setVelocity", made(head, "MotorGoalVelocity", "tilt", -1.0, 1.0))
    began = head.worker.world.time
    head.wait_for_computes(11)
    passed = head.worker.world.time - began
    assert call(head, "getMotorState", "tilt").vel == pytest.approx(-passed)
    assert call(head, "getMotorState", "tilt").pos == pytest.approx(0.5 - passed**2 / 2)


def test_several_motors_move_together_or_not_at_all(head: ComponentTest) -> None:
    goals = [made(head, "MotorGoalPosition", name, 0.1, 0.0) for name in ("pan", "tilt")]
    call(head, "setSyncPosition", goals)
    assert [each.pos for each in call(head, "getAllMotorState").values()] == [0.1, 0.1]
    wrong = [made(head, "MotorGoalPosition", "tilt", 0.2, 0.0), made(head, "MotorGoalPosition", "lift", 0.0, 0.0)]
    with pytest.raises(Exception, match="unknown motor `lift`; known: pan, tilt") as refused:
        call(head, "setSyncPosition", wrong)
    assert type(refused.value).__name__ == "UnknownMotorException"
    speeds = [made(head, "MotorGoalVelocity", "pan", 1.0, 0.0), made(head, "MotorGoalVelocity", "tilt", math.nan, 0.0)]
    with pytest.raises(Exception, match="nan is no speed") as refused:
        call(head, "setSyncVelocity", speeds)
    assert type(refused.value).__name__ == "HardwareFailedException"
    assert {(each.pos, each.isMoving) for each in call(head, "getAllMotorState").values()} == {(0.1, False)}
    call(head, "setSyncZeroPos")
    assert [each.pos for each in call(head, "getAllMotorState").values()] == [0.25, 0.5]


@pytest.mark.parametrize("operation", ["getMotorState", "getMotorParams", "setZeroPos"])
def test_a_name_that_no_motor_has_is_refused(operation: str, head: ComponentTest) -> None:
    with pytest.raises(Exception, match="unknown motor `tlit`; did you mean `tilt`") as refused:
        call(head, operation, "tlit")
    assert type(refused.value).__name__ == "UnknownMotorException"


def test_states_are_published(head: ComponentTest) -> None:
    call(head, "setPosition", made(head, "MotorGoalPosition", "pan", -0.5, 0.0))

    def told() -> list[Any]:
        return [states for (states,) in head.received("jointmotorpub.motorStates")]

    head.wait_for(lambda: any("pan" in states and states["pan"].pos == -0.5 for states in told()))
    head.wait_for(lambda: {("pan", "tilt"), ("lift",)} == {tuple(states) for states in told()})
