"""A tree and its model of MuJoCo have the same kinematics, whatever moves."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocomp_py.innermodel import axes
from robocomp_py.innermodel.mesh import read_mesh
from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.build import build
from robocomp_py.sim.world import World

LENGTHS = st.floats(-3000, 3000)
ANGLES = st.floats(-3, 3)
PLACED = ("transform", "translation", "rotation", "joint", "differentialrobot", "omnirobot")


@st.composite
def trees(draw: st.DrawFn) -> Tree:
    """Any nodes, each below any before it."""
    tree, names = Tree(), ["root"]
    for number in range(draw(st.integers(1, 12))):
        tag, name = draw(st.sampled_from((*PLACED, "prismaticjoint", "plane"))), f"node{number}"
        values: dict[str, float | str] = {}
        if tag in PLACED and tag != "rotation":
            values |= {each: draw(LENGTHS) for each in ("tx", "ty", "tz")}
        if tag in PLACED and tag != "translation":
            values |= {each: draw(ANGLES) for each in ("rx", "ry", "rz")}
        if tag in ("joint", "prismaticjoint"):
            values["axis"] = draw(st.sampled_from("xyz"))
        if tag == "prismaticjoint":
            values["offset"] = draw(LENGTHS)
        if tag == "plane":
            values |= {each: draw(LENGTHS) for each in ("nx", "ny", "nz", "px", "py", "pz")}
        if tag == "transform":
            values["engine"] = draw(st.sampled_from(("static", "bullet")))
        tree.add(draw(st.sampled_from(names)), tag, name, **values)
        if tag != "plane":
            names.append(name)
    return tree


def farthest(tree: Tree, move: st.DataObject) -> float:
    """How far a node is elsewhere in the two, m, after all joints and bases were moved."""
    scene = build(tree, 0.005)
    data = mujoco.MjData(scene.model)
    data.qpos[:] = scene.start
    for joint in scene.joints.values():
        angle = move.draw(ANGLES)
        if joint.slides:
            data.qpos[joint.place] = tree.update_prismatic(joint.name, 100 * angle) / 1000 + joint.offset
        else:
            data.qpos[joint.place] = tree.update_joint(joint.name, angle)
    hoisted = {name for name in tree.ids if tree.node(name).values.get("engine") == "bullet"}
    for name in hoisted:  # they stay where they are in the world, whatever moves above them
        above = name
        while (above := tree.node(above).parent) != "":
            if above in scene.joints or above in scene.bases:
                return 0.0
    for base in scene.bases.values():
        x, z, turn = move.draw(LENGTHS), move.draw(LENGTHS), move.draw(ANGLES)
        values = tree.node(base.name).values
        tree.update_transform(base.name, (x, values["ty"], z, values["rx"], turn, values["rz"]))  # type: ignore[arg-type]
        data.qpos[[base.x, base.z, base.turn]] = x / 1000, z / 1000, turn
    mujoco.mj_kinematics(scene.model, data)
    worst = 0.0
    for name, frame in scene.frames.items():
        turned = data.xmat[frame.body].reshape(3, 3)
        position = axes.position_from_simulation(data.xpos[frame.body] + turned @ frame.position)
        wanted = tree.matrix("root", name)
        worst = max(worst, float(np.abs(position - wanted[:3, 3]).max()) / 1000)
        worst = max(worst, float(np.abs(axes.rotation_from_simulation(turned @ frame.rotation) - wanted[:3, :3]).max()))
    return worst


@settings(deadline=None, max_examples=60)
@given(trees(), st.data())
def test_every_node_is_where_the_tree_has_it(tree: Tree, move: st.DataObject) -> None:
    assert farthest(tree, move) < 1e-9


@pytest.mark.parametrize(
    ("size", "extents"),
    [((), (2500, 2500, 25)), ((800.0,), (800, 800, 8)), ((800.0, 400.0), (800, 400, 4)), ((-3.0, 2.0, 1.0), (3, 2, 1))],
)
def test_a_plane_is_a_box(size: tuple[float, ...], extents: tuple[float, ...]) -> None:
    tree = Tree()
    tree.add("root", "plane", "wall", **({"size": size} if size else {}))
    scene = build(tree, 0.005)
    depth, width, height = scene.model.geom_size[0] * 2000
    assert (width, height, depth) == pytest.approx(extents)


WEDGE = """\
v 0 0 0
v 100 0 0
v 0 200 0
v 0 0 300
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


def test_a_mesh_lies_as_its_file_has_it_with_z_towards_the_viewer(tmp_path: Path) -> None:
    (tmp_path / "wedge.obj").write_text(WEDGE)
    mesh = read_mesh(tmp_path / "wedge.obj", (2.0, 1.0))
    assert sorted(map(tuple, mesh.vertices.tolist())) == [(0, 0, -600), (0, 0, 0), (0, 200, 0), (200, 0, 0)]
    (tmp_path / "room.xml").write_text(
        '<innerModel><mesh id="wedge" file="wedge.obj" tz="2000"/>'
        '<laser id="laser" measures="4" angle="6.283185307179586" max="9000"/>'
        '<transform id="low" ty="50" tx="20" ><laser id="aside" measures="1" angle="0" max="9000"/></transform>'
        "</innerModel>"
    )
    room = World(Tree.read(tmp_path / "room.xml"))
    point = 300 * (1 - 20 / 100 - 50 / 200)
    assert room.scan("aside")[0] == pytest.approx(2000 - point)


def test_a_mesh_stops_a_base(tmp_path: Path) -> None:
    (tmp_path / "wedge.obj").write_text(WEDGE)
    (tmp_path / "room.xml").write_text(
        '<innerModel><mesh id="wedge" file="wedge.obj" tz="2000" collide="1"/>'
        '<omnirobot id="base" collide="1"><plane id="body" size="50,50,50" px="10" py="10" collide="1"/></omnirobot>'
        "</innerModel>"
    )
    room = World(Tree.read(tmp_path / "room.xml"), hold=0)
    room.drive("base", ahead=1000)
    room.step(1000)
    assert 1600 < room.odometry("base").z < 1700


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("cup.step", "", "meshes are read from .obj, .dae, .stl"),
        ("cup.obj", "nothing of a mesh", "cup.obj: "),
        ("cup.stl", "solid", "cup.stl: "),
        ("cup.ply", "\0\1\2", "cup.ply: the mesh cannot be read"),
        ("cup.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "cup.obj: the mesh has points that are not finite"),
    ],
)
def test_a_file_that_is_no_mesh_is_refused(name: str, content: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(InnerModelError) as refused:
        read_mesh(tmp_path / name)
    assert text in str(refused.value)


def test_ids_may_be_those_that_a_base_and_a_gripper_would_make_of_theirs() -> None:
    tree, parameters = Tree(), {}
    for name in ("base", "base.x", "base.turn", "base.ahead"):
        tree.add("root", "differentialrobot" if name == "base" else "joint", name)
    for name in ("box", "b holds box"):
        tree.add("root", "transform", name, engine="bullet")
    for name in ("a", "a holds b"):
        tree.add("base", "transform", name)
        tree.add(name, "plane", f"cup of {name}")
        parameters[name] = {"suction": 5.0}
    world = World(tree, parameters=parameters)
    world.move_joint("base.x", 0.5)
    assert (world.position("base.x"), world.odometry("base").x) == (0.5, 0.0)
    assert world.grippers == ["a", "a holds b"]
