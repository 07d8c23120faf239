"""A scene that is made from the one before it is the same as one that is made anew."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.build import Scene, build, rebuilt
from robocomp_py.sim.world import Overlap, World

from .scenes import WEDGE

HALL = """\
<innerModel>
  <transform id="world">
    <plane id="floor" size="20000,10,20000" py="-5"/>
    <differentialrobot id="base" collide="1">
      <plane id="body" size="300,300,300" py="150" collide="1"/>
      <transform id="mount" ty="400"><laser id="eye" measures="40" angle="6.28" max="9000"/></transform>
      <joint id="arm" ty="400" axis="x"><plane id="hand" size="50,50,50" py="300"/></joint>
    </differentialrobot>
    <transform id="shelf" tz="3000" ry="0.3">
      <plane id="board" size="900,20,300" py="600" collide="1"/>
      <plane id="back" size="900,1200,20" py="600" pz="150" texture="#884422"/>
      <mesh id="vase" file="wedge.obj" ty="700"/>
      <laser id="still" measures="20" angle="3" max="9000"/>
    </transform>
    <transform id="box" tx="2000" ty="101" engine="bullet" mass="1"><plane id="card" size="200,200,200"/></transform>
  </transform>
</innerModel>
"""


@pytest.fixture
def hall(tmp_path: Path) -> Tree:
    (tmp_path / "hall.xml").write_text(HALL)
    (tmp_path / "wedge.obj").write_text(WEDGE)
    return Tree.read(tmp_path / "hall.xml")


def described(scene: Scene) -> dict[str, object]:
    """A scene by names: the order of geoms may differ."""
    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[:] = scene.start
    mujoco.mj_kinematics(model, data)
    geoms = {
        name: (
            model.body(model.geom_bodyid[number]).name,
            *(np.round(each[number], 9).tolist() for each in (data.geom_xpos, data.geom_xmat, model.geom_size)),
            np.round(model.geom_friction[number], 9).tolist(),
            np.round(model.geom_rgba[number], 6).tolist(),
            bool(scene.stops[number]),
            [base.name for base in scene.bases.values() if base.shapes[number]],
        )
        for number, name in enumerate(scene.shapes)
    }
    frames = {
        name: (each.body, np.round(each.position, 9).tolist(), np.round(each.rotation, 9).tolist())
        for name, each in scene.frames.items()
    }
    excluded = sorted(
        tuple(sorted(model.body(each).name for each in divmod(pair, 1 << 16)))
        for pair in model.exclude_signature.tolist()
    )
    servos = np.round(model.actuator_gainprm[:, 0], 6).tolist(), np.round(model.actuator_forcerange, 6).tolist()
    return {"geoms": geoms, "frames": frames, "excluded": excluded, "servos": servos, "movable": scene.movable}


def changed(tree: Tree, edit: Callable[[Tree], object]) -> Tree:
    made = tree.copy()
    edit(made)
    return made


STILL: dict[str, Callable[[Tree], object]] = {
    "add": lambda tree: tree.add("world", "plane", "new", size=(100.0, 200.0, 300.0), pz=900.0, py=400.0),
    "add below": lambda tree: tree.add("shelf", "plane", "new", size=(100.0,), texture="#ff0000", collide=True),
    "add two": lambda tree: (
        tree.add("world", "transform", "at", ty=900.0),
        tree.add("at", "plane", "new", size=(9.0,)),
    ),
    "remove": lambda tree: tree.remove("back"),
    "move": lambda tree: tree.update_transform("shelf", (100, 200, 3100, 0.1, 0.2, 0.3)),
    "resize": lambda tree: tree.set_value("board", "size", (100.0, 100.0, 100.0)),
    "paint": lambda tree: tree.set_value("back", "texture", "#00ff00"),
    "stop": lambda tree: tree.set_value("back", "collide", True),
    "to another parent": lambda tree: tree.move("board", "world"),
    "a laser": lambda tree: tree.add("world", "laser", "new", measures=3, angle=1.0, max=1000.0),
    "nothing": lambda tree: None,
}


@pytest.mark.parametrize("name", STILL)
def test_what_stands_still_is_changed_in_the_scene(name: str, hall: Tree) -> None:
    tree = changed(hall, STILL[name])
    made = rebuilt(build(hall, 0.005), tree)
    assert made
    assert described(made) == described(build(tree, 0.005))


MOVING: dict[str, Callable[[Tree], object]] = {
    "a base": lambda tree: tree.set_value("base", "ty", 10.0),
    "part of a robot": lambda tree: tree.set_value("body", "size", (200.0, 300.0, 300.0)),
    "a joint": lambda tree: tree.update_joint("arm", 0.5),
    "a free body": lambda tree: tree.set_value("box", "mass", 2.0),
    "a new joint": lambda tree: tree.add("shelf", "joint", "hinge"),
    "what a robot stands on": lambda tree: tree.set_value("floor", "size", (9000.0, 10.0, 9000.0)),
    "what a robot would stand on": lambda tree: tree.add("world", "plane", "rug", size=(900.0, 1.0, 900.0)),
    "a mesh": lambda tree: tree.set_value("vase", "scale", (2.0,)),
    "onto a robot": lambda tree: tree.move("board", "base"),
    "from a robot": lambda tree: tree.move("hand", "world"),
    "another tag": lambda tree: (tree.remove("back"), tree.add("world", "transform", "back")),
}


@pytest.mark.parametrize("name", MOVING)
def test_what_moves_needs_a_new_scene(name: str, hall: Tree) -> None:
    assert rebuilt(build(hall, 0.005), changed(hall, MOVING[name])) is None


def test_what_is_added_at_once_has_the_same_order_in_every_process(hall: Tree) -> None:
    def add(tree: Tree) -> None:
        for name in "abcdefgh":
            tree.add("world", "plane", name, size=(9.0,), py=900.0)

    made = rebuilt(build(hall, 0.005), changed(hall, add))
    assert made
    assert [name for name in made.shapes if len(name) == 1] == list("hgfedcba")


def test_friction_of_what_is_above_is_that_of_the_new_parent(hall: Tree) -> None:
    parameters = {"shelf": {"friction": 0.3}}
    tree, scene = changed(hall, STILL["to another parent"]), build(hall, 0.005, parameters=parameters)
    assert rebuilt(scene, tree, parameters) is None
    tree = changed(hall, STILL["add below"])
    made = rebuilt(scene, tree, parameters)
    assert made
    assert described(made) == described(build(tree, 0.005, parameters=parameters))
    assert rebuilt(scene, tree, {"shelf": {"friction": 0.4}}) is None


def test_after_many_edits_a_world_is_as_if_it_had_begun_like_that(hall: Tree) -> None:
    world, chosen = World(hall, seed=1), random.Random(4)
    for number in range(60):
        tree, boxes = world.tree.copy(), [name for name in world.tree.ids if name.startswith("box_")]
        if boxes and chosen.random() < 0.3:
            tree.remove(chosen.choice(boxes))
        elif boxes and chosen.random() < 0.4:
            tree.set_value(chosen.choice(boxes), "px", chosen.uniform(-4000, 4000))
        else:
            where = {"px": chosen.uniform(-4000, 4000), "pz": chosen.uniform(600, 4000), "py": chosen.uniform(300, 600)}
            tree.add(chosen.choice(("world", "shelf")), "plane", f"box_{number}", size=(200.0, 300.0, 100.0), **where)
        world.change(tree)
    anew = World(world.tree, seed=1)
    assert len(world.tree) > 15
    for laser in ("eye", "still"):
        assert world.scan(laser) == pytest.approx(anew.scan(laser), abs=1e-6)
    assert world.collide("board", "vase") == anew.collide("board", "vase")
    world.set_physics(True)
    world.drive("base", ahead=200.0)
    world.step(50)
    assert world.odometry("base").z == pytest.approx(50, abs=5)


def bits(world: World) -> tuple[bytes, str]:
    """All of the model of a world, and of its state."""
    model = world.view().scene.model
    saved = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, saved)
    return saved.tobytes(), world.digest()


BLOCK = {"size": (300.0,), "py": 150.0, "collide": True}
REJECTED: dict[str, Callable[[Tree], object]] = {
    "add": lambda tree: tree.add("world", "plane", "block", **BLOCK),
    "add and move": lambda tree: (
        tree.add("shelf", "plane", "a"),
        tree.update_transform("shelf", (0, -450, 0, 0, 0, 0)),
    ),
    "remove and add": lambda tree: (tree.remove("back"), tree.add("world", "plane", "block", **BLOCK)),
    "remove and move": lambda tree: (tree.remove("back"), tree.update_transform("shelf", (0, -450, 0, 0, 0, 0))),
    "without a file": lambda tree: (tree.set_value("board", "px", 3.0), tree.set_value("vase", "file", "x.obj")),
}


@pytest.mark.parametrize("name", REJECTED)
def test_an_edit_that_is_rejected_leaves_no_trace(name: str, hall: Tree) -> None:
    """The edits after it end in the same bits as without it."""
    world, other = World(hall, physics=True), World(hall, physics=True)
    for edit in (STILL["add below"], STILL["paint"], STILL["move"], lambda tree: tree.remove("new"), STILL["remove"]):
        before = bits(world)
        with pytest.raises((Overlap, InnerModelError)):
            world.change(changed(world.tree, REJECTED[name]))
        assert bits(world) == before
        for each in (world, other):
            each.change(changed(each.tree, edit))
        assert bits(world) == bits(other)


def test_a_copy_that_is_edited_as_the_world_is_the_same(hall: Tree) -> None:
    """It is edited after the world, or before it."""
    world = World(hall, physics=True)
    world.change(changed(hall, STILL["add two"]))
    world.change(changed(world.tree, lambda tree: tree.add("shelf", "plane", "later")))
    other = world.copy()
    for edit in (STILL["remove"], STILL["resize"], lambda tree: tree.remove("new"), STILL["move"]):
        for each in (world, other):
            each.change(changed(each.tree, edit))
        assert bits(world) == bits(other)
        world, other = other, world.copy()


def test_devices_that_stand_still_come_move_and_go(hall: Tree) -> None:
    world = World(hall)
    for edit in (STILL["add"], with_devices, STILL["move"], STILL["remove"]):
        world.change(changed(world.tree, edit))
        anew = World(world.tree)
        for kind in ("lasers", "lidars", "cameras", "displays", "imus", "touch_sensors", "movable"):
            assert getattr(world, kind) == getattr(anew, kind)
        for laser in {*world.lasers} - {"still"}:  # that one is as low as the edge of a shape
            assert world.scan(laser) == pytest.approx(anew.scan(laser), abs=1e-6)
        for sensor in world.touch_sensors:
            assert world.touch(sensor) == anew.touch(sensor)
    world.change(changed(world.tree, lambda tree: tree.remove("sensors")))
    assert world.lasers == ["eye", "still"]
    assert not [*world.cameras, *world.displays, *world.imus, *world.touch_sensors]


def with_devices(tree: Tree) -> None:
    tree.add("shelf", "transform", "sensors", ty=900.0)
    tree.add("sensors", "laser", "new_laser", measures=3, angle=1.0, max=9000.0)
    tree.add("sensors", "rgbd", "new_rgbd", width=8, height=6, focal=5.0)
    tree.add("sensors", "imu", "new_imu")
    tree.add("sensors", "display", "new_display", size=(100.0,))
    tree.add("sensors", "touchsensor", "new_bumper", type="bumper")


def test_a_copy_that_is_edited_leaves_the_world_as_it_was(hall: Tree) -> None:
    world = World(hall)
    before, saved = world.scan("eye").tolist(), world.save()
    other = world.copy()
    other.change(changed(hall, STILL["add"]))
    assert other.scan("eye").tolist() != before
    assert world.scan("eye").tolist() == before
    world.restore(saved)
    other.change(changed(other.tree, lambda tree: tree.remove("new")))
    assert other.scan("eye") == pytest.approx(before)
    assert other.digest() == world.digest()
