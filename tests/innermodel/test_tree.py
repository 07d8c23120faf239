"""A tree of frames: where things are, how they move, and what cannot be."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.innermodel import axes
from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree

HOUSE = """\
<innerModel>
  <transform id="world">
    <plane id="floor" ny="1" size="4000,4000,10"/>
    <differentialrobot id="base" tx="1000" tz="500" ry="1.5707963267948966">
      <translation id="mount" ty="300" tz="100">
        <laser id="laser" port="10003" measures="4" angle="2" max="4000"/>
        <rgbd id="eye" width="640" height="480" focal="500"/>
      </translation>
      <joint id="shoulder" ty="200" rx="0.3" axis="x" min="-1" max="1">
        <joint id="elbow" ty="100" axis="z">
          <prismaticjoint id="slide" axis="y" offset="50" max="80"><transform id="hand" tz="20"/></prismaticjoint>
        </joint>
      </joint>
    </differentialrobot>
  </transform>
</innerModel>
"""


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    path = tmp_path / "house.xml"
    path.write_text(HOUSE)
    return Tree.read(path)


def close(found: np.ndarray, wanted: object, within: float = 1e-9) -> bool:
    return bool(np.allclose(found, np.asarray(wanted, dtype=float), rtol=0, atol=within))


def test_a_turn_about_y_is_to_the_right(tree: Tree) -> None:
    assert close(tree.transform("world", (0, 0, 100), "base"), (1100, 0, 500))
    assert close(tree.transform("base", (1100, 0, 500), "world"), (0, 0, 100))


def test_a_pose_is_transformed_with_its_angles(tree: Tree) -> None:
    pose = tree.transform("world", (0, 0, 100, 0, 0.25, 0), "base")
    assert close(pose, (1100, 0, 500, 0, math.pi / 2 + 0.25, 0))


def test_many_points_are_transformed_as_one_is(tree: Tree) -> None:
    points = np.random.default_rng(1).uniform(-1000, 1000, (50, 3))
    single = [tree.transform("hand", point, "eye") for point in points]
    assert close(tree.transform_points("hand", points, "eye"), single)


def test_the_way_back_is_the_inverse(tree: Tree) -> None:
    assert close(tree.matrix("hand", "laser") @ tree.matrix("laser", "hand"), np.eye(4))


def test_a_joint_keeps_its_offset_and_its_limits(tree: Tree) -> None:
    assert tree.update_joint("shoulder", 5.0) == 1.0
    assert tree.position("shoulder") == 1.0
    assert close(tree.rotation("base", "shoulder"), axes.rotation(1.3, 0, 0))
    assert close(tree.translation("base", "shoulder"), (0, 200, 0))


def test_a_joint_loses_its_offset_if_it_is_to_be_as_in_robocomp(tmp_path: Path) -> None:
    path = tmp_path / "house.xml"
    path.write_text(HOUSE)
    tree = Tree.read(path, drops_offsets=True)
    assert close(tree.translation("base", "shoulder"), (0, 200, 0))
    tree.update_joint("shoulder", 0.5)
    assert close(tree.matrix("base", "shoulder")[:3, :3], axes.rotation(0.5, 0, 0))
    assert close(tree.translation("base", "shoulder"), (0, 0, 0))


def test_a_prismatic_joint_slides_by_its_position_and_offset(tree: Tree) -> None:
    assert tree.update_prismatic("slide", 100.0) == 80.0
    assert close(tree.translation("elbow", "hand"), (0, 130, 20))


def test_what_is_below_a_moved_node_moves_with_it(tree: Tree) -> None:
    before = tree.translation("world", "laser")
    tree.update_translation("base", (0, 0, 0))
    assert close(tree.translation("world", "laser"), before - (1000, 0, 500))


def test_a_camera_sees_what_it_projects(tree: Tree) -> None:
    assert close(tree.project("eye", (0, 0, 1000), "eye"), (320, 240))
    assert close(
        tree.project("eye", (100, 50, 1000), "eye"), (370, 215)
    )  # right and up: a larger column, a smaller row
    assert np.isnan(tree.project("eye", (0, 0, -1), "eye")).all()
    point = tree.transform("world", (30, -40, 700), "eye")
    assert close(tree.back_project("eye", tree.project("eye", point), 700), point, 1e-6)


def test_a_ray_of_a_laser_to_the_right_ends_at_the_right(tree: Tree) -> None:
    assert close(tree.laser_to("laser", 1000, math.pi / 2, "laser"), (1000, 0, 0))
    assert close(tree.laser_to("laser", 1000, 0, "world"), tree.transform("world", (0, 0, 1000), "laser"))


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.integers(0, 2**32 - 1))
def test_the_jacobian_equals_finite_differences(angles: tuple[float, float, float], seed: int) -> None:
    tree = Tree()
    above = "root"
    random = np.random.default_rng(seed)
    joints = []
    for number, angle in enumerate(angles):
        name, kind = f"j{number}", "prismaticjoint" if number == 1 else "joint"
        tree.add(above, kind, name, axis="xyz"[random.integers(3)])
        (tree.update_prismatic if number == 1 else tree.update_joint)(name, angle)
        above = f"t{number}"
        tree.add(name, "transform", above)
        tree.update_transform(above, (*random.uniform(-200, 200, 3), *random.uniform(-1, 1, 3)))
        joints.append(name)
    tree.add("t0", "transform", "camera", tx=10.0, ry=0.3)
    point = random.uniform(-50, 50, 3)
    for base in ("root", "camera"):
        made = tree.jacobian(joints, above, base, point)
        for column, name in enumerate(joints):
            assert close(made[:, column], _difference(tree, name, above, base, point), 1e-4)


def _difference(tree: Tree, joint: str, frame: str, base: str, point: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """How a frame moves with a joint, by two poses near the present one."""
    update = tree.update_joint if tree.node(joint).tag == "joint" else tree.update_prismatic
    now, ends = tree.position(joint), []
    for offset in (step, -step):
        update(joint, now + offset)
        ends.append((tree.transform(base, point, frame), tree.rotation(base, frame)))
    update(joint, now)
    (one, turned), (other, back) = ends
    turn = (turned - back) / (2 * step) @ tree.rotation(base, frame).T
    return np.array((*(one - other) / (2 * step), turn[2, 1], turn[0, 2], turn[1, 0]))


@given(st.tuples(*[st.floats(-3.2, 3.2)] * 3))
def test_the_angles_of_a_rotation_give_it_again(turn: tuple[float, float, float]) -> None:
    matrix = axes.rotation(*turn)
    assert close(axes.rotation(*axes.angles(matrix)), matrix, 1e-6)


def test_the_smaller_of_two_solutions_is_taken() -> None:
    assert close(axes.angles(axes.rotation(0, 3.0, 0)), (0, 3.0, 0))


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda each: math.hypot(*each) > 1e-3))
def test_the_depth_of_a_plane_is_along_its_normal(normal: tuple[float, float, float]) -> None:
    turn = axes.along_normal(normal)
    assert close(turn @ turn.T, np.eye(3), 1e-6)
    assert np.linalg.det(turn) > 0
    unit = np.asarray(normal) / np.linalg.norm(normal)
    wanted = unit if not np.allclose(unit, (0, 0, 1)) else (0, 0, -1)
    assert close(turn @ (0, 0, -1), wanted, 1e-5) or close(turn @ (0, 0, -1), unit, 1e-5)


@pytest.mark.parametrize("beside", [1e-3, 1e-5, 1e-6])
def test_a_plane_that_almost_lies_on_its_back_is_turned_without_being_distorted(beside: float) -> None:
    turn = axes.along_normal((beside, beside, 1.0))
    assert close(turn @ turn.T, np.eye(3), 1e-9)


def test_the_axes_of_the_simulator_are_right_handed() -> None:
    ahead, right, up = axes.position_to_simulation(np.array(((0, 0, 1000), (1000, 0, 0), (0, 1000, 0)), dtype=float))
    assert close(ahead, (1, 0, 0))
    assert close(right, (0, -1, 0))
    assert close(up, (0, 0, 1))
    assert np.linalg.det(axes.TO_SIMULATION) == pytest.approx(-1)


def test_a_turn_to_the_right_is_one_in_the_simulator() -> None:
    turned = axes.rotation_to_simulation(axes.rotation(0, 0.5, 0))
    rate = axes.turn_to_simulation(np.array((0.0, 0.5, 0.0)))
    assert close(rate, (0, 0, -0.5))  # clockwise, seen from above
    assert close(turned, [[math.cos(0.5), math.sin(0.5), 0], [-math.sin(0.5), math.cos(0.5), 0], [0, 0, 1]])
    assert close(axes.rotation_from_simulation(turned), axes.rotation(0, 0.5, 0))
    assert close(axes.turn_from_simulation(rate), (0, 0.5, 0))


def test_a_copy_does_not_move_with_its_original(tree: Tree) -> None:
    tree.update_joint("elbow", 0.4)
    copied = tree.copy()
    tree.update_joint("elbow", 0.8)
    assert copied.position("elbow") == 0.4
    assert copied.ids == tree.ids


CHANGES: dict[str, Callable[[Tree], object]] = {
    "nothing": lambda tree: None,
    "a value": lambda tree: tree.set_value("base", "tx", 5.0),
    "a value and back": lambda tree: (
        tree.set_value("base", "tx", 5.0),
        tree.set_value("base", "tx", 1000.0),
    ),
    "a joint": lambda tree: tree.update_joint("elbow", 0.3),
    "a parent": lambda tree: tree.move("hand", "world"),
    "a new node": lambda tree: tree.add("hand", "imu", "imu"),
    "a node that is gone": lambda tree: tree.remove("hand"),
    "a node that was gone": lambda tree: (tree.add("hand", "imu", "imu"), tree.remove("imu")),
    "another tag": lambda tree: (tree.remove("hand"), tree.add("elbow", "rgbd", "hand")),
    "many nodes": lambda tree: [(tree.add("world", "imu", f"{n}"), tree.remove(f"{n}")) for n in range(99)],
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_copy_differs_in_what_was_changed_as_a_tree_that_was_read_again_does(name: str, tmp_path: Path) -> None:
    (tmp_path / "house.xml").write_text(HOUSE)
    tree, again = Tree.read(tmp_path / "house.xml"), Tree.read(tmp_path / "house.xml")
    copied, ids = tree.copy(), tree.ids
    for each in (copied, again):
        CHANGES[name](each)
    assert tree.differences(copied) == tree.differences(again) == again.differences(tree)
    assert copied.differences(again) == set()
    assert copied.copy().differences(copied) == set()
    assert copied.ids == again.ids
    assert tree.ids == ids


def test_nodes_are_added_moved_and_removed(tree: Tree) -> None:
    tree.add("hand", "mesh", "cup", file="cup.obj", ty=10.0)
    assert close(tree.translation("hand", "cup"), (0, 10, 0))
    tree.move("cup", "world")
    assert tree.node("cup").parent == "world"
    tree.remove("base")
    assert tree.ids == ["root", "world", "floor", "cup"]
    assert "hand" not in tree


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda tree: tree.transform("wrld", (0, 0, 0), "base"), "did you mean `world`?"),
        (lambda tree: tree.update_joint("base", 1.0), "`base` is a differentialrobot, not a joint"),
        (lambda tree: tree.update_prismatic("elbow", 1.0), "not a prismaticjoint"),
        (lambda tree: tree.update_translation("base", (math.nan, 0, 0)), "`tx` is `nan`, which is no finite number"),
        (lambda tree: tree.set_value("elbow", "port", 99999), "`port` is a whole number of at most 65535, not `99999`"),
        (lambda tree: tree.set_value("elbow", "port", -1), "`port` is negative"),
        (lambda tree: tree.set_value("elbow", "axis", "w"), "`axis` is `x`, `y` or `z`, not `w`"),
        (lambda tree: tree.set_value("base", "collide", 2), "`collide` is 0 or 1, not `2`"),
        (lambda tree: tree.set_value("base", "tx", "near"), "`tx` is a number, not `near`"),
        (lambda tree: tree.add("hand", "plane", "box", size=(1, 2, 3, 4)), "`size` has 4 numbers"),
        (lambda tree: tree.add("hand", "plane", "box", size=("a",)), "`size` is numbers with commas between them"),
        (lambda tree: tree.add("hand", "plane", "box", texture="\x01"), "no XML file can have"),
        (lambda tree: tree.add("hand", "mesh", "cup", file="cup.obj", scale=0), "`scale` is 0 for an axis"),
        (lambda tree: tree.update_translation("eye", (1, 2, 3)), "unknown attribute of a rgbd `tx`"),
        (lambda tree: tree.set_value("base", "id", "robot"), "cannot be changed"),
        (lambda tree: tree.add("hand", "cup", "cup"), "unknown tag `cup`"),
        (lambda tree: tree.add("eye", "imu", "imu"), "has no children"),
        (lambda tree: tree.add("hand", "imu", "eye"), "there is a `eye` already"),
        (lambda tree: tree.add("hand", "imu", "imu", prt=1), "did you mean `port`?"),
        (lambda tree: tree.add("hand", "imu", "\n"), "is no id"),
        (lambda tree: tree.remove("root"), "`root` stays"),
        (lambda tree: tree.move("base", "hand"), "`hand` is below `base`"),
        (lambda tree: tree.project("laser", (0, 0, 1)), "`laser` is a laser, not a camera"),
        (lambda tree: tree.laser_to("eye", 1, 0), "`eye` is no laser"),
        (lambda tree: tree.jacobian(["base"], "hand", "world"), "not a joint"),
    ],
)
def test_a_wrong_change_says_why_and_changes_nothing(
    tree: Tree, change: Callable[[Tree], object], message: str
) -> None:
    before = tree.texts(), tree.ids, tree.matrix("world", "hand").tolist()
    with pytest.raises(InnerModelError, match=re.escape(message)):
        change(tree)
    assert (tree.texts(), tree.ids, tree.matrix("world", "hand").tolist()) == before


@pytest.mark.parametrize("values", [(1, 2), (1, 2, 3, 4), ()])
def test_a_point_has_three_numbers_and_a_pose_six(tree: Tree, values: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="a point has 3 numbers"):
        tree.transform("world", values, "base")


def test_a_file_with_errors_is_refused_with_all_of_them(tmp_path: Path) -> None:
    path = tmp_path / "house.xml"
    path.write_text('<innerModel><joint id="a" axis="w"/><imu id="a"/></innerModel>')
    with pytest.raises(InnerModelError, match="axis") as raised:
        Tree.read(path)
    assert [each.code for each in raised.value.problems] == ["wrong-value", "repeated-id"]
