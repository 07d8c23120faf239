"""Conveyors carry bodies, and suction cups hold them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.plans import Command, evaluate, follow
from robocomp_py.sim.world import World

CRANE = """\
<innerModel>
  <plane id="floor" size="20000,10,20000" py="-5"/>
  <omnirobot id="crane" ty="1000">
    <prismaticjoint id="rope" axis="y" min="-900" max="0">
      <translation id="hook" ty="-100"><plane id="cup" size="60,20,60" py="-10"/></translation>
    </prismaticjoint>
  </omnirobot>
  <transform id="box" ty="101" engine="bullet" mass="1"><plane id="side" size="200,200,200"/></transform>
  <transform id="far" ty="101" tx="2000" engine="bullet" mass="1"><plane id="edge" size="200,200,200"/></transform>
</innerModel>
"""
LOWER = [Command(0.0, "rope", (-675.0, 900.0))]
CARRY = [
    Command(0.0, "cup", (1.0,)),
    Command(0.1, "rope", (-300.0, 500.0)),
    Command(1.0, "crane", (0.0, 500.0)),
    Command(1.8, "crane", (0.0,)),
]


def world(folder: Path, text: str = CRANE, **parameters: dict[str, float]) -> World:
    path = folder / "scene.xml"
    path.write_text(text)
    return World(Tree.read(path), physics=True, parameters=parameters)


@pytest.fixture
def crane(tmp_path: Path) -> World:
    return world(tmp_path, cup={"suction": 10.0})


@pytest.mark.parametrize("speed", [200.0, -300.0])
def test_a_conveyor_carries_a_box_along_its_z(speed: float, tmp_path: Path) -> None:
    text = """<innerModel><rotation id="turned" ry="0.5"><plane id="belt" size="400,100,9000" py="-50"/></rotation>
    <transform id="box" ty="101" engine="bullet"><plane id="side" size="200,200,200"/></transform></innerModel>"""
    hall = world(tmp_path, text, belt={"belt": speed})
    hall.step(100)
    before = hall.matrix("box", "turned")[:3, 3]
    hall.step(400)
    assert hall.matrix("box", "turned")[:3, 3] - before == pytest.approx((0, 0, 2 * speed), abs=1)


def test_a_cup_lifts_what_it_reaches_and_lets_it_go(crane: World) -> None:
    assert crane.grippers == ["cup"]
    assert crane.grip("cup") == crane.held("cup") == ""
    follow(crane, LOWER, 1.5)  # to 5 mm above the box
    assert crane.grip("cup") == "box"
    crane.move_joint("rope", -300, speed=500)
    crane.step(300)
    assert crane.matrix("box")[1, 3] == pytest.approx(100 + 375, abs=5)
    assert crane.matrix("far")[1, 3] == pytest.approx(100, abs=1)
    crane.release("cup")
    assert crane.held("cup") == ""
    crane.step(300)
    assert crane.matrix("box")[1, 3] == pytest.approx(100, abs=1)


def test_plans_grip_without_a_change_of_the_world_and_end_as_they_said(crane: World) -> None:
    follow(crane, LOWER, 1.5)
    before, saved = crane.digest(), crane.save()
    carried, again, left = evaluate(crane, [CARRY, CARRY, CARRY[1:]], 2.0)
    assert crane.digest() == before
    assert carried.digest == again.digest
    assert carried.poses["box"][-1, 0, 3] == pytest.approx(400, abs=30)
    assert left.poses["box"][-1, 0, 3] == pytest.approx(0, abs=1)
    assert follow(crane, CARRY, 2.0).digest == carried.digest
    assert crane.held("cup") == "box"
    lifted = crane.save()
    crane.restore(saved)
    assert (crane.digest(), crane.held("cup")) == (before, "")
    crane.restore(lifted)
    copy = crane.copy()
    for each in (crane, copy):
        each.drive("crane", aside=-300)
        each.step(100)
    assert crane.digest() == copy.digest()
    assert crane.matrix("box")[1, 3] == pytest.approx(475, abs=5)


def test_a_fixed_magnet_lets_go_what_hung_still(tmp_path: Path) -> None:
    text = """<innerModel><plane id="magnet" size="100,20,100" py="2000"/><plane id="floor"/>
    <transform id="ball" ty="1935" engine="bullet"><plane id="side" size="100,100,100"/></transform></innerModel>"""
    hall = world(tmp_path, text, magnet={"suction": 10.0})
    assert hall.grip("magnet") == "ball"
    hall.step(600)
    assert hall.matrix("ball")[1, 3] == pytest.approx(1935, abs=2)
    hall.release("magnet")
    hall.step(20)
    assert hall.matrix("ball")[1, 3] < 1900


def test_what_is_held_is_held_after_an_edit(crane: World) -> None:
    follow(crane, [*LOWER, Command(1.4, "cup", (1.0,))], 1.5)
    tree = crane.tree.copy()
    tree.add("root", "plane", "shelf", py=3000.0)
    crane.change(tree)
    assert crane.held("cup") == "box"
    crane.move_joint("rope", -300, speed=500)
    crane.step(300)
    assert crane.matrix("box")[1, 3] == pytest.approx(475, abs=5)


def test_without_physics_nothing_is_held(crane: World) -> None:
    follow(crane, LOWER, 1.5)
    crane.grip("cup")
    crane.set_physics(False)
    assert crane.held("cup") == crane.grip("cup") == ""
    where = crane.matrix("box")
    crane.move_joint("rope", -300)
    crane.step(10)
    assert np.array_equal(crane.matrix("box"), where)
    with pytest.raises(InnerModelError, match="unknown gripper `hook`"):
        crane.grip("hook")
