"""Scenes from URDF and MJCF."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.innermodel import axes
from robocomp_py.innermodel.mesh import read_mesh
from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.importing import Imported, converted, imported
from robocomp_py.sim.world import World

from .scenes import WEDGE

ARM = """\
<robot name="arm">
  <link name="foot"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="upper">
    <inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.2" rpy="0.3 0 0"/><geometry><box size="0.06 0.06 0.4"/></geometry></collision>
  </link>
  <link name="lens"/>
  <joint name="shoulder" type="revolute">
    <parent link="foot"/><child link="upper"/>
    <origin xyz="0 0 0.05" rpy="0.1 0.2 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" effort="9" velocity="1"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="upper"/><child link="lens"/><origin xyz="0.1 0 0.4" rpy="0 0.5 0"/>
  </joint>
</robot>
"""
WALKER = """\
  <geom name="floor" type="plane" size="0 1.5 .05"/>
  <body name="cup" pos="1 2 3" quat=".5 .5 .5 .5"><freejoint name="loose"/><geom size=".1" mass="2"/>
    <body name="lid" pos="0 0 .1">
      <joint name="hinge" axis="0 1 1" pos=".1 .2 .3" range="-20 40"/>
      <joint name="slide" type="slide" axis="1 0 1" range="-2.01 .11" ref="0.1"/>
      <geom name="rim" type="capsule" size=".03 .3" pos="0 .1 .2" euler="10 20 30" rgba="1 0 .2 1"/>
    </body>
  </body>
"""


MOVED = {"upper": "shoulder_moved", "lid": "slide_moved"}
"""The frames of bodies with joints, after their joints."""


def mjcf(world: str, more: str = "") -> Imported:
    return converted(mujoco.MjModel.from_xml_string(f"<mujoco>{more}<worldbody>{world}</worldbody></mujoco>"))


def test_shapes_are_where_mujoco_has_them_however_joints_move(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    spec = mujoco.MjSpec.from_file(str(tmp_path / "arm.urdf"))
    spec.compiler.fusestatic = False
    walker = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{WALKER}</worldbody></mujoco>")
    random = np.random.default_rng(1)
    for model, tree in (
        (spec.compile(), imported(tmp_path / "arm.urdf").tree),
        (walker, converted(walker).tree),
    ):
        data = mujoco.MjData(model)
        for _ in range(20):
            for number in range(model.njnt):
                joint, place = model.joint(number), model.jnt_qposadr[number]
                if joint.name in tree and tree.node(joint.name).tag == "joint":
                    data.qpos[place] = model.qpos0[place] + tree.update_joint(joint.name, random.uniform(-2, 2))
                elif joint.name in tree:
                    moved = tree.update_prismatic(joint.name, random.uniform(-3000, 3000))
                    data.qpos[place] = model.qpos0[place] + moved / 1000
            mujoco.mj_kinematics(model, data)
            for number in range(1, model.nbody):
                name = model.body(number).name
                found = tree.matrix("root", MOVED.get(name, name))
                assert axes.position_to_simulation(found[:3, 3]) == pytest.approx(data.xpos[number], abs=1e-5)
                turn = axes.rotation_to_simulation(found[:3, :3])
                assert turn.ravel() == pytest.approx(data.xmat[number], abs=1e-5)
            for number in range(model.ngeom):
                name = model.geom(number).name or f"geom{number}"
                if name != "floor":
                    place = tree.transform("root", (0, 0, 0), f"{name}_at")
                    assert axes.position_to_simulation(place) == pytest.approx(data.geom_xpos[number], abs=1e-5)


def test_limits_are_those_from_where_a_joint_begins() -> None:
    tree = mjcf(WALKER).tree
    assert (tree.node("slide").values["min"], tree.node("slide").values["max"]) == (-2110.0, 10.0)
    assert tree.node("hinge").values["max"] == pytest.approx(np.radians(40), abs=1e-6)


def test_links_that_cannot_move_keep_their_frames(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    assert {"foot", "upper", "lens"} <= set(imported(tmp_path / "arm.urdf").tree.ids)


def test_a_link_that_is_only_seen_has_its_shape_and_others_their_solid_ones(tmp_path: Path) -> None:
    """Collada is usual for what is seen, and MuJoCo cannot read it."""
    picture = '<visual><geometry><mesh filename="package://a/hand.dae"/></geometry><material name="red"/></visual>'
    box = '<geometry><box size="0.1 0.2 0.3"/></geometry>'
    solid, seen = f"<collision>{box}</collision>", f"<visual>{box}</visual>"
    links = {"solid": picture + solid, "seen": seen, "lost": picture}
    text = "".join(f'<link name="{name}">{shapes}</link>' for name, shapes in links.items())
    joints = "".join(
        f'<joint name="to_{name}" type="fixed"><parent link="solid"/><child link="{name}"/></joint>'
        for name in ("seen", "lost")
    )
    red = '<material name="red"><color rgba="1 0 0 1"/></material>'
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{red}{text}{joints}</robot>')
    found = imported(tmp_path / "arm.urdf")
    planes = [found.tree.node(name) for name, tag in found.tree.tags.items() if tag == "plane"]
    above = [found.tree.node(found.tree.node(each.parent).parent).id for each in planes]
    assert sorted(zip(above, [each.values["texture"] for each in planes], strict=True)) == [
        ("seen", ""),
        ("solid", "#ff0000"),
    ]
    assert found.left_out == [
        "shapes that touch nothing, of links that also have solid ones: 1",
        "the shape package://a/hand.dae of lost: MuJoCo reads .obj, .stl, .msh",
    ]


def test_files_of_packages_are_looked_for_beside_and_above_the_file(tmp_path: Path) -> None:
    mesh = '<collision><geometry><mesh filename="package://arm_description/meshes/wedge.obj"/></geometry></collision>'
    text = f'<robot name="arm"><link name="foot">{mesh}</link></robot>'
    inside, beside = tmp_path / "arm_description" / "urdf" / "arm.urdf", tmp_path / "robots" / "arm.urdf"
    for path in (inside, beside):
        path.parent.mkdir(parents=True)
        path.write_text(text)
    with pytest.raises(InnerModelError, match="a file of the package NAME is looked for in folders NAME"):
        imported(inside)
    (tmp_path / "arm_description" / "meshes").mkdir()
    (tmp_path / "arm_description" / "meshes" / "wedge.obj").write_text(WEDGE)
    for path in (inside, beside):
        assert list(imported(path).meshes) == ["meshes/wedge.obj"]


def test_links_need_no_mass(tmp_path: Path) -> None:
    lines = [each for each in ARM.splitlines() if "<inertial>" not in each and "0.06" not in each]
    (tmp_path / "arm.urdf").write_text("\n".join(lines))
    assert "shoulder" in imported(tmp_path / "arm.urdf").tree


def test_what_has_a_free_joint_moves_freely() -> None:
    tree = mjcf(WALKER).tree
    assert (tree.node("cup").values["engine"], tree.node("cup").values["mass"]) == ("bullet", 2.0)
    assert "loose" not in tree
    world = World(tree, physics=True)
    before = world.matrix("cup")[1, 3]
    world.step(20)
    assert world.matrix("cup")[1, 3] == pytest.approx(before - 9810 * 0.1**2 / 2, rel=0.1)


def test_a_ball_joint_is_refused_with_what_to_do() -> None:
    with pytest.raises(InnerModelError, match=r"body swing: joint0 is a ball joint, .*: replace it by three hinges"):
        mjcf('<body name="swing"><joint type="ball"/><geom size=".1"/></body>')


def test_a_plane_of_mjcf_becomes_a_thin_box_below_it() -> None:
    tree = mjcf('<geom name="floor" type="plane" size="0 1.5 .05" pos="0 0 2"/>').tree
    values = tree.node("floor").values
    assert values["size"] == (3000.0, 10.0, 20000.0)
    assert tree.transform("root", (0, 5 + float(str(values["py"])), 0), "floor_at") == pytest.approx((0, 2000, 0))


def test_joints_without_a_name_and_with_the_name_of_their_body_get_ids() -> None:
    inner = '<body name="arm"><joint name="arm"/><geom name="arm" size=".1"/></body>'
    tree = mjcf(f'<body name="root"><joint/><geom size=".1"/>{inner}</body>').tree
    assert [name for name, tag in tree.tags.items() if tag == "joint"] == ["joint0", "arm_joint"]
    assert {"root_body", "geom0", "arm_geom"} <= set(tree.ids)


def test_ids_of_frames_that_the_import_adds_may_be_names_of_the_file() -> None:
    inner = '<body><joint name="hip"/><geom name="x_at" size=".1"/><geom name="x" size=".1"/></body>'
    tree = mjcf(f'<body name="hip_axis"><body name="hip_moved">{inner}</body></body>').tree
    assert [tree.node(each).parent for each in ("hip", "x")] == ["hip_axis0", "x_at0"]
    assert tree.node("x_at").parent == "x_at_at"
    assert tree.node("hip_moved0").parent == "hip"


def test_meshes_whose_names_differ_in_a_slash_alone_have_files_of_their_own() -> None:
    corners = "0 0 0  {0} 0 0  0 {0} 0  0 0 {0}"
    shapes = (("a/b", 1), ("a_b", 2), ("a/b", 1))
    assets = "".join(f'<mesh name="{name}" vertex="{corners.format(size)}"/>' for name, size in shapes[:2])
    geoms = "".join(f'<geom type="mesh" mesh="{name}"/>' for name, _ in shapes)
    found = mjcf(f"<body>{geoms}</body>", f"<asset>{assets}</asset>")
    files = [found.tree.node(f"geom{number}").values["file"] for number in range(3)]
    assert files == ["meshes/a_b.obj", "meshes/a_b0.obj", "meshes/a_b.obj"]
    assert len(set(found.meshes.values())) == 2


def test_of_a_link_that_is_there_twice_the_shapes_that_touch_are_kept() -> None:
    seen = 'contype="0" conaffinity="0" size=".1"'
    found = mjcf(f'<body><geom name="a" size=".1"/><geom name="b" {seen}/></body><body><geom name="c" {seen}/></body>')
    assert {"a", "c"} <= set(found.tree.ids)
    assert "b" not in found.tree
    assert found.left_out == ["shapes that touch nothing, of links that also have solid ones: 1"]


def test_colours_of_shapes_and_of_materials_are_kept() -> None:
    found = mjcf(
        '<geom name="a" size=".1" rgba="1 0 .2 1"/><geom name="b" size=".1" material="wood"/>'
        '<geom name="c" size=".1"/>',
        '<asset><material name="wood" rgba=".5 .25 0 1"/></asset>',
    ).tree
    assert [found.node(each).values["texture"] for each in "abc"] == ["#ff0033", "#804000", ""]


def test_a_mesh_is_written_beside_the_scene_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A tetrahedron that is its own mirror image nowhere."""
    asset = '<asset><mesh name="tip" vertex="0 0 0  .3 0 0  0 .2 0  0 0 .1"/></asset>'
    body = '<body pos="0 0 1"><joint name="turn" axis="0 0 1"/><geom type="mesh" mesh="tip" rgba="1 0 0 1"/></body>'
    (tmp_path / "tip.xml").write_text(f"<mujoco>{asset}<worldbody>{body}</worldbody></mujoco>")
    scene = tmp_path / "made" / "scene.xml"
    scene.parent.mkdir()
    assert rc(["sim", "import", str(tmp_path / "tip.xml"), "-o", str(scene)]) == 0
    tree = Tree.read(scene)
    path = tree.file("geom0")
    assert path == scene.parent / "scene_meshes" / "tip-ff0000.obj"
    assert path
    mesh = read_mesh(path)
    assert (mesh.colours == (255, 0, 0)).all()
    points = tree.transform_points("root", mesh.vertices, "geom0")
    wanted = {(0, 1000, 0), (0, 1000, 300), (-200, 1000, 0), (0, 1100, 0)}  # right, up, ahead
    assert {tuple(each) for each in points.round().astype(int).tolist()} == wanted
    there = axes.position_to_simulation(points)[mesh.faces]
    normals = np.cross(there[:, 1] - there[:, 0], there[:, 2] - there[:, 0])
    outwards = there.mean(axis=1) - axes.position_to_simulation(points).mean(axis=0)
    assert (np.einsum("ij,ij->i", normals, outwards) > 0).all()
    assert "scene.xml has 6 nodes" in capsys.readouterr().out
    assert rc(["sim", "import", str(tmp_path / "tip.xml"), "-o", str(scene)]) == 1
    assert "scene.xml is there already; choose another file by -o" in capsys.readouterr().err


def test_a_scene_is_written_into_a_new_folder_or_it_is_told_why_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    assert rc(["sim", "import", str(tmp_path / "arm.urdf"), "-o", str(tmp_path / "made" / "arm.xml")]) == 0
    assert (tmp_path / "made" / "arm.xml").exists()
    inside = tmp_path / "made" / "arm.xml" / "again"
    assert rc(["sim", "import", str(tmp_path / "arm.urdf"), "-o", str(inside / "arm.xml")]) == 1
    assert capsys.readouterr().err == f"rc sim import: {inside}: Not a directory\n"


def test_of_an_import_that_cannot_be_written_nothing_remains(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = "n" * 300  # too long for a file
    asset = f'<asset><mesh name="a" file="wedge.obj"/><mesh name="{name}" file="wedge.obj"/></asset>'
    geoms = f'<geom type="mesh" mesh="a"/><geom type="mesh" mesh="{name}"/>'
    (tmp_path / "wedge.obj").write_text(WEDGE)
    (tmp_path / "arm.xml").write_text(f"<mujoco>{asset}<worldbody>{geoms}</worldbody></mujoco>")
    before = sorted(tmp_path.iterdir())
    assert rc(["sim", "import", str(tmp_path / "arm.xml"), "-o", str(tmp_path / "scene.xml")]) == 1
    assert capsys.readouterr().err.endswith(f"{name}.obj: File name too long\n")
    assert sorted(tmp_path.iterdir()) == before


ROOM = """\
<innerModel>
  <plane id="floor" size="9000,10,9000" py="-5"/>
  <differentialrobot id="base" tx="-1500" ry="0.5">
    <plane id="body" py="200" size="300,200,400"/>
    <joint id="arm" ty="300" axis="x"><mesh id="wedge" file="wedge.obj"/></joint>
  </differentialrobot>
  <transform id="box" ty="900" engine="bullet" mass="2"><plane id="sides" size="100,100,100"/></transform>
</innerModel>
"""


def test_mujoco_alone_moves_an_exported_scene_as_it_moves_here(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wedge.obj").write_text(WEDGE)
    (tmp_path / "room.xml").write_text(ROOM)
    assert rc(["sim", "export", "room.xml"]) == 0
    model = mujoco.MjModel.from_xml_path("room.mjcf")
    data, world = mujoco.MjData(model), World(Tree.read(tmp_path / "room.xml"), physics=True)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    world.move_joint("arm", 0.5)
    data.ctrl[model.actuator(".arm").id] = 0.5
    for _ in range(50):
        mujoco.mj_step(model, data)
    mujoco.mj_kinematics(model, data)
    world.step(50)
    for name in ("base", "arm", "box"):
        there = axes.position_from_simulation(data.body(f".{name}").xpos)
        assert there == pytest.approx(world.matrix(name)[:3, 3], abs=0.5)
    assert data.joint(".arm").qpos.item() == pytest.approx(world.position("arm"), abs=1e-3)
    assert rc(["sim", "export", "room.xml"]) == 1
    assert "room.mjcf is there already; choose another file by -o" in capsys.readouterr().err
    (tmp_path / "wedge.obj").unlink()
    assert rc(["sim", "export", "room.xml", "-o", "other.mjcf"]) == 1
    assert "room.xml:5:39: `wedge`: there is no file `wedge.obj`\n" in capsys.readouterr().err
    assert not (tmp_path / "other.mjcf").exists()


def test_numbers_of_a_converted_scene_are_not_inexact(tmp_path: Path) -> None:
    limited = '<joint type="slide" limited="true" range="-2.01 .11"/>'
    mjcf(f'<body>{limited}<geom type="capsule" size=".03 .3"/></body>').tree.save(tmp_path / "arm.xml")
    text = (tmp_path / "arm.xml").read_text()
    assert 'size="60,660,60"' in text
    assert 'min="-2010" max="110"' in text


def test_what_a_scene_does_not_have_is_left_out_and_told() -> None:
    hills = '<asset><hfield name="hills" nrow="2" ncol="2" size="1 1 1 1" elevation="0 0 1 1"/></asset>'
    follows = '<equality><joint joint1="b" joint2="a"/></equality>'
    one, other = (f'<body><joint name="{each}"/><geom size=".1"/></body>' for each in "ab")
    found = mjcf(f'<geom type="hfield" hfield="hills"/>{one}{other}<camera/><camera/>', hills + follows)
    assert "geom0" not in found.tree
    assert found.left_out == ["the hfield hills", "2 cameras", "that b follows a"]


def test_a_warning_of_mujoco_is_told_with_the_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "old.xml").write_text(f'<mujoco><compiler settotalmass="9"/><worldbody>{WALKER}</worldbody></mujoco>')
    assert rc(["sim", "import", str(tmp_path / "old.xml"), "-o", str(tmp_path / "scene.xml")]) == 0
    said = capsys.readouterr()
    assert "MuJoCo warns: compiler attribute 'settotalmass' is deprecated" in said.out
    assert not said.err


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("arm.urdf", "", "MuJoCo cannot read it"),
        ("arm.xml", "<mujoco><worldbody><bodi/></worldbody></mujoco>", "MuJoCo cannot read it"),
        ("arm.xml", '<mujoco><asset><mesh file="cup.stl"/></asset></mujoco>', "cup.stl"),
        ("arm.urdf", '<robot name="a" xmlns:xacro="x/xacro"><xacro:include/></robot>', "by `xacro FILE > FILE.urdf`"),
        ("arm.xml", "<mujoco/>", "it has no link and no shape"),
        ("", "", "it is a folder"),
        ("arm.xml", "<!-- mine --><innerModel/>", "arm.xml is a scene already; to see it: rc sim view"),
        ("armm.urdf", None, "arm.urdf`?"),
    ],
)
def test_a_file_that_cannot_be_read_is_told(
    name: str, text: str | None, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if text is None:
        (tmp_path / "arm.urdf").write_text(ARM)
    elif name:
        (tmp_path / name).write_text(text)
    assert rc(["sim", "import", str(tmp_path / name), "-o", str(tmp_path / "scene.xml")]) == 1
    error = capsys.readouterr().err
    assert error.startswith("rc sim import: ")
    assert told in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "scene.xml").exists()
