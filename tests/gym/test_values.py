"""Actions and observations, and the types of the operations that they belong to."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocomp_py.gym import Range
from robocomp_py.gym.values import Action, Observation
from robocomp_py.testing.simulation import network_parts
from robocomp_py.virtual.outside import Provided, provided

SPEED = "base/DifferentialRobot/setSpeedBase"
GOAL = "joints/JointMotor/setPosition"
SCAN = "laser/Laser/getLaserData"
POSE = "base/DifferentialRobot/getBasePose"


@pytest.fixture(scope="module")
def network(networks: Path) -> Mapping[str, Provided]:
    return provided(network_parts(networks / "scene.ddsl"))


def test_parts_of_an_action_are_taken_in_their_order(network: Mapping[str, Provided]) -> None:
    name = "joints/JointMotor/setSyncPosition"
    goals = [
        {"name": "pan", "position": Range(0.0, 10.0), "maxSpeed": Range(1.0, 2.0)},
        {"name": "tilt", "position": Range(-1.0, 1.0), "maxSpeed": 0.5},
    ]
    action = Action(name, network[name].operation, {"listGoals": goals})
    assert action.size == 3
    (made,) = action.arguments(iter([-1.0, 0.0, 0.5]))
    assert [(each.name, each.position, each.maxSpeed) for each in made] == [("pan", 0.0, 1.5), ("tilt", 0.5, 0.5)]


def test_whole_numbers_and_bools_are_chosen_as_such(network: Mapping[str, Provided]) -> None:
    place = Action(
        "x", network["base/DifferentialRobot/setOdometerPose"].operation, {"x": Range(0, 9), "z": 1, "alpha": 0.0}
    )
    assert [place.arguments(iter([share]))[0] for share in (-1.0, -0.95, 1.0)] == [0, 0, 9]
    physics = Action("x", network["house/Simulation/setPhysics"].operation, {"on": Range(0, 1)})
    assert [physics.arguments(iter([share])) for share in (-0.5, 0.5)] == [(False,), (True,)]


def test_numbers_arrive_as_the_wire_carries_them(network: Mapping[str, Provided]) -> None:
    action = Action(SPEED, network[SPEED].operation, {"adv": Range(0, 1), "rot": 0.1})
    adv, rot = action.arguments(iter([-0.8]))
    assert (adv, rot) == (float(np.float32(0.1)), float(np.float32(0.1)))


@pytest.mark.parametrize(
    ("name", "arguments", "says"),
    [
        (SPEED, {"adv": Range(0, 1)}, "lacks `rot`"),
        (SPEED, {"adv": Range(0, 1), "rott": 0.0}, "did you mean `rot`"),
        (SPEED, {"adv": Range(0, 1), "rot": "fast"}, "setSpeedBase.*rot"),
        (SPEED, {"adv": Range(0, 1e300), "rot": 0.0}, "setSpeedBase.*adv"),
        (SPEED, {"adv": [Range(0, 1)], "rot": 0.0}, "setSpeedBase.*adv"),
        (GOAL, {"goal": {"name": "pan", "position": Range(0, 1)}}, "lacks `maxSpeed`"),
        (GOAL, {"goal": {"name": Range(0, 1), "position": 0.0, "maxSpeed": 0.0}}, "setPosition.*name"),
        (GOAL, {"goal": ("pan", Range(0, 1))}, "has 2 values; its fields are name, position, maxSpeed"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(
    network: Mapping[str, Provided], name: str, arguments: dict[str, Any], says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        Action(name, network[name].operation, arguments)


def observation(network: Mapping[str, Provided], name: str, path: str, bounds: Range | None) -> Observation:
    return Observation(f"{name}.{path}", network[name].operation.outputs, path, bounds)


@pytest.mark.parametrize(
    ("name", "path", "bounds", "says"),
    [
        (SCAN, "ret[*]", None, r"name a field of it: ret\[\*\].angle"),
        (SCAN, "ret", None, r"name a field of its items: ret\[\*\].angle"),
        (SCAN, "ret[*].dust", None, "did you mean `dist`"),
        (SCAN, "ret[*].dist", None, "give a Range"),
        (SCAN, "ret[*].dist", Range(0, 1e300), "cannot be from"),
        (POSE, "x", Range(-1e10, 1e10), "cannot be from"),
        (POSE, "*", Range(0, 1), "several types"),
        (POSE, "x..", None, "no path"),
        ("laser/Laser/getLaserConfData", "ret.driver", None, "no number"),
    ],
)
def test_what_is_no_observation_is_refused(
    network: Mapping[str, Provided], name: str, path: str, bounds: Range | None, says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        observation(network, name, path, bounds)


def test_numbers_beyond_the_bounds_become_those_and_nan_is_refused(network: Mapping[str, Provided]) -> None:
    alpha = observation(network, POSE, "alpha", Range(-1.0, 1.0))
    assert alpha.of((1, 2, 3.0)).tolist() == [1.0]
    with pytest.raises(ValueError, match=r"getBasePose.alpha is NaN"):
        alpha.of((1, 2, math.nan))
    assert observation(network, POSE, "x", Range(-10.5, 10.5)).of((50, 2, 3.0)).tolist() == [10]


def test_a_value_of_a_dictionary_is_observed(network: Mapping[str, Provided]) -> None:
    name = "joints/JointMotor/getAllMotorState"
    position = Observation("pan", network[name].operation.outputs, "mstateMap.pan.pos", Range(-1.0, 1.0))
    kind: Any = network[name].operation.outputs[0].type
    assert position.of(({"pan": kind.value.python(pos=0.5)},)).tolist() == [0.5]


def test_all_numbers_of_a_struct_are_observed_by_a_star(network: Mapping[str, Provided]) -> None:
    name = "house/InnerModelManager/getPoseFromParent"
    pose = Observation("pose", network[name].operation.outputs, "pose.*", Range(-100.0, 100.0))
    kind: Any = network[name].operation.outputs[1].type
    assert pose.of((True, kind.python(1.0, 2.0, 3.0, 4.0, 5.0, 6.0))).tolist() == [1, 2, 3, 4, 5, 6]
