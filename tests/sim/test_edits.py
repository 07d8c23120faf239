"""A world whose tree is edited while it goes on."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from robocomp_py.innermodel import axes
from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.world import Overlap, World

ROOM = """\
<innerModel>
  <transform id="world">
    <plane id="floor" size="9000,10,9000" py="-5"/>
    <transform id="stand" tx="2000"><plane id="wall" size="10,2000,900" collide="1"/></transform>
    <differentialrobot id="base" collide="1">
      <plane id="body" size="300,300,300" py="151" collide="1"/>
      <translation id="mount" ty="200">
        <laser id="laser" measures="4" angle="6.283185307179586" max="5000"/>
      </translation>
      <joint id="pan" ty="400" axis="y"><transform id="eye"/></joint>
    </differentialrobot>
    <transform id="box" tz="-3000" ty="1000" engine="bullet" mass="2"><plane id="side" size="200,200,200"/></transform>
  </transform>
</innerModel>
"""
RIGHT = 1
"""The ray of the laser that looks to the right."""


@pytest.fixture
def room(tmp_path: Path) -> World:
    (tmp_path / "room.xml").write_text(ROOM)
    return World(Tree.read(tmp_path / "room.xml"), hold=0, seed=3)


def test_the_next_scan_sees_an_edit(room: World) -> None:
    assert room.scan("laser")[RIGHT] == pytest.approx(1995)
    tree = room.tree.copy()
    tree.update_transform("stand", (1500, 0, 0, 0, 0, 0))
    room.change(tree)
    assert room.scan("laser")[RIGHT] == pytest.approx(1495)
    tree = room.tree.copy()
    tree.remove("stand")
    room.change(tree)
    assert room.scan("laser")[RIGHT] == 5000
    with pytest.raises(InnerModelError, match="unknown node `wall`"):
        room.matrix("wall")


def test_what_stays_keeps_its_state(room: World) -> None:
    other = room.copy()
    for each in (room, other):
        each.set_physics(True)
        each.set_noise("base", 0.1)
        each.drive("base", ahead=200, turn=0.1)
        each.drive_joint("pan", 1.0, acceleration=0.5)
        each.step(30)
    tree = room.tree.copy()
    tree.add("world", "transform", "shelf", tx=-3000.0)
    tree.add("shelf", "plane", "board", size=(100.0, 100.0, 100.0))
    tree.add("world", "joint", "gate", axis="y")
    room.change(tree)
    for each in (room, other):
        each.step(30)
    for name in ("base", "eye", "box"):
        assert np.allclose(room.matrix(name), other.matrix(name), rtol=0, atol=1e-6)
    assert (room.ticks, room.odometry("base")) == (60, pytest.approx(other.odometry("base")))
    assert room.joint_speed("pan") == pytest.approx(other.joint_speed("pan"))
    assert room.digest() != other.digest()
    assert room.position("gate") == pytest.approx(0.0)


def test_an_edit_stops_what_meets_it(room: World) -> None:
    tree = room.tree.copy()
    tree.add("world", "plane", "barrier", pz=600.0, size=(900.0, 900.0, 20.0))
    tree.set_value("barrier", "collide", True)
    room.change(tree)
    room.drive("base", ahead=1000)
    room.step(400)
    assert 430 < room.matrix("base")[2, 3] <= 440


def test_bases_and_free_bodies_are_put_elsewhere(room: World) -> None:
    room.drive("base", ahead=100)
    room.step(10)
    room.change(
        room.tree.copy(),
        {
            "base": axes.pose((500.0, 0.0, 700.0), axes.rotation(0.0, 0.3, 0.0)),
            "box": axes.pose((10.0, 20.0, 30.0), axes.rotation(0.1, 0.2, 0.3)),
        },
    )
    assert np.allclose(room.matrix("base"), axes.pose((500.0, 0.0, 700.0), axes.rotation(0.0, 0.3, 0.0)), atol=1e-9)
    assert np.allclose(room.matrix("box"), axes.pose((10.0, 20.0, 30.0), axes.rotation(0.1, 0.2, 0.3)), atol=1e-9)
    assert room.odometry("base").z == pytest.approx(5)  # wheels do not notice that they are lifted


def test_a_base_is_not_put_into_what_stops_it(room: World) -> None:
    before = room.digest()
    with pytest.raises(Overlap, match=r"`body` would be 55\.0 mm deep in `wall`"):
        room.change(room.tree.copy(), {"base": axes.pose((1900.0, 0.0, 0.0), np.eye(3))})
    tree = room.tree.copy()
    tree.update_transform("stand", (100, 0, 0, 0, 0, 0))
    with pytest.raises(Overlap, match="deep in `wall`"):
        room.change(tree)
    assert room.digest() == before
    assert room.scan("laser")[RIGHT] == pytest.approx(1995)


def test_an_edit_that_cannot_be_simulated_changes_nothing(room: World) -> None:
    before = room.digest()
    tree = room.tree.copy()
    tree.add("world", "mesh", "cup", file="cup.obj")
    with pytest.raises(InnerModelError, match=r"there is no file `cup\.obj`"):
        room.change(tree)
    assert room.digest() == before
    assert "cup" not in room.tree


def test_a_copy_keeps_its_tree(room: World) -> None:
    copy = room.copy()
    tree = room.tree.copy()
    tree.remove("stand")
    room.change(tree)
    assert copy.scan("laser")[RIGHT] == pytest.approx(1995)
    assert "stand" in copy.tree


def test_a_reset_keeps_edits_and_forgets_places(room: World) -> None:
    tree = room.tree.copy()
    tree.update_transform("stand", (1500, 0, 0, 0, 0, 0))
    room.change(tree, {"base": axes.pose((0.0, 0.0, 800.0), np.eye(3))})
    room.reset()
    assert room.matrix("base")[2, 3] == 0
    assert room.scan("laser")[RIGHT] == pytest.approx(1495)


def test_a_reset_to_the_first_tree_undoes_edits(room: World) -> None:
    first, fresh = room.tree, room.digest()
    tree = first.copy()
    tree.remove("stand")
    tree.remove("pan")
    room.change(tree, {"base": axes.pose((2000.0, 0.0, 0.0), np.eye(3))})  # where the wall was
    room.reset(tree=first)
    assert room.scan("laser")[RIGHT] == pytest.approx(1995)
    assert room.joints == ["pan"]
    assert room.digest() == fresh


def test_shapes_collide_where_they_overlap(room: World) -> None:
    assert not room.collide("base", "stand")
    room.change(room.tree.copy(), {"box": axes.pose((1950.0, 100.0, 0.0), axes.rotation(0.0, math.pi / 4, 0.0))})
    assert room.collide("box", "stand")
    assert room.collide("wall", "side")
    assert not room.collide("box", "floor")
    assert not room.collide("laser", "stand")
