"""Two arms at a conveyor, and two arms that hand over a bottle."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from robocomp_py.cli import rc, rcgen
from robocomp_py.innermodel import axes
from robocomp_py.innermodel.tree import Tree
from robocomp_py.testing.components import ComponentTest, load_component, stand_ins
from robocomp_py.testing.simulation import Simulation

from ..seeds import SEEDS
from .conftest import COMPONENTS

NETWORKS = {"conveyor": "sorter", "handover": "handover"}
"""The client of each, which ends when all is done."""

RESTS = {"belt", "leftbench", "rightbench", "table"}
"""What parts and the bottle lie on."""

Settings = Sequence[tuple[str, str]]

SHORT: dict[str, Settings] = {
    "conveyor": [("sorter", "params.parts=1")],
    "handover": [("handover", "params.times=1")],
}

Touching = tuple[str, str]


def run(network: str, seed: int, settings: Settings = ()) -> set[Touching]:
    """Run a network until its client has ended; also what touched meanwhile, each time that the scene went on."""
    touching: set[Touching] = set()
    with Simulation(COMPONENTS / f"{network}.ddsl", seed, settings=settings) as sim:
        sim.run(0.0)
        world, client, tick = sim["world"].worker.world, sim[NETWORKS[network]], 0

        def is_over() -> bool:
            nonlocal tick
            if world.ticks != tick:
                tick = world.ticks
                touching.update(world.touching())
            return client.is_over()

        assert sim.run(until=is_over, at_most=120.0), f"not done after {sim.time} s"
        assert sim.failed == []
        check(network, world, sim["sorter"].worker.params.parts if network == "conveyor" else 0)
    return touching


def check(network: str, world: Any, parts: int) -> None:
    """Everything is where it belongs, and stands."""
    if network == "handover":
        pose = world.matrix("bottle")
        assert pose[1, 3] == pytest.approx(100, abs=1)
        assert pose[1, 1] > 0.999, "it has fallen over"
        return
    for number in range(parts):
        pose, side = world.matrix(f"part{number + 1}"), 1 if number % 2 else -1
        x, z = side * 600 + 100 * (number // 2 - 1), 1150 if number % 2 else 150
        assert pose[:3, 3] == pytest.approx([x, 30, z], abs=10)
        assert pose[1, 1] > 0.999, "it has fallen over"


def collisions(touching: set[Touching]) -> set[Touching]:
    """Of those, what is neither a grasp nor something that lies there."""
    things = ("block", "glass")
    fine = {
        pair
        for pair in touching
        for thing, other in (pair, pair[::-1])
        if thing.startswith(things) and (other in RESTS or other.endswith("cup"))
    }
    return touching - fine


@pytest.mark.parametrize("network", NETWORKS)
def test_the_models_are_without_diagnostics_and_what_is_generated_belongs_to_them(
    network: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scenes = [str(each) for each in (COMPONENTS / "cell").glob("*.xml")]
    assert rc.main(["lint", str(COMPONENTS / f"{network}.ddsl"), *scenes]) == 0
    assert not any(capsys.readouterr())
    assert rcgen.main(["--check", str(COMPONENTS / f"{network}.ddsl")]) == 0, capsys.readouterr().out


@pytest.mark.parametrize(("network", "seed"), [("conveyor", 1), ("handover", 2)])
def test_a_short_story_ends_well(network: str, seed: int) -> None:
    touching = run(network, seed, SHORT[network])
    assert touching
    assert collisions(touching) == set()


@pytest.mark.tool  # takes minutes
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("network", NETWORKS)
def test_every_seed_ends_well_and_nothing_collides(network: str, seed: int) -> None:
    """Of the bottle, this is 4 times 20 places. Every tick is looked at with two seeds: that takes twice as long."""
    every_tick = [("world", "component.period=0.005")] if seed < 2 else []
    assert collisions(run(network, seed, every_tick)) == set()


def test_what_is_no_grasp_is_a_collision() -> None:
    assert collisions({("block1", "leftcup"), ("belt", "block1"), ("glass", "table")}) == set()
    wrong = {("block1", "block2"), ("leftcup", "rightcup"), ("leftcup", "table"), ("glass", "leftfore")}
    assert collisions(wrong) == wrong


# The component `arm` alone.

for name in ("arm", "sorter", "handover"):
    load_component(COMPONENTS / name)
kinematics = import_module("arm.kinematics")


@pytest.mark.parametrize("tool", ["lefttool", "righttool"])
def test_speeds_of_joints_lead_the_tool_to_its_goal(tool: str) -> None:
    arm = kinematics.Arm(Tree.read(COMPONENTS / "cell" / "table.xml"), tool)
    assert len(arm.joints) == 7
    side = 1 if tool == "righttool" else -1
    goal = kinematics.pose((side * 100.0, 250.0, 120.0), (0.0, -side * 1.2, 0.0))
    positions, away = dict(zip(arm.joints, arm.home.tolist(), strict=True)), math.inf
    for _ in range(150):
        way = arm.way(positions, goal, np.zeros(3), (500.0, 2.0))
        assert np.abs(way.speeds).max() <= kinematics.FASTEST + 1e-9
        positions = {name: positions[name] + 0.02 * speed for name, speed in zip(arm.joints, way.speeds, strict=True)}
        away = way.distance
    assert away < 1.0
    assert way.turn < 0.01
    for _ in range(150):
        way = arm.way_home(positions)
        positions = {name: positions[name] + 0.02 * speed for name, speed in zip(arm.joints, way.speeds, strict=True)}
    assert list(positions.values()) == pytest.approx(arm.home.tolist(), abs=0.01)


@pytest.mark.parametrize("angle", [0.0, 0.4, -2.9])
@pytest.mark.parametrize("axis", "xyz")
def test_a_rotation_has_an_axis_and_an_angle(axis: str, angle: float) -> None:
    expected = [angle if each == axis else 0.0 for each in "xyz"]
    assert kinematics.turned(axes.about(axis, angle)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ('tool="lefttol"', "did you mean `lefttool`"),
        ('tool="table"', "`table` has no joint above it"),
        ('scene="no.xml"', "there is no such file"),
    ],
)
def test_an_arm_that_is_not_in_the_scene_is_told(setting: str, says: str, caplog: pytest.LogCaptureFixture) -> None:
    with Simulation(COMPONENTS / "handover.ddsl", settings=[("left", f"params.{setting}")]) as sim:
        sim.run(0.1)
        assert sim.failed == ["left"]
    assert says in caplog.text
    assert "Traceback" not in caplog.text


@pytest.fixture
def arm() -> Iterator[ComponentTest]:
    worker = load_component(COMPONENTS / "arm")
    with ComponentTest(worker, stand_ins(worker), virtual=True) as component:
        yield component


def test_a_goal_that_is_not_finite_is_refused(arm: ComponentTest) -> None:
    pose = import_module("arm.generic.RoboCompArm").Pose
    with pytest.raises(Exception, match="must be finite"):
        arm.call("Arm.move", pose(math.nan, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0)
    assert arm.call("Arm.isThere") is False
