"""Pictures against what can be computed by hand. They need OpenGL."""

from __future__ import annotations

import hashlib
import logging
import math
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robocomp_py.errors import ConfigurationError
from robocomp_py.innermodel import axes
from robocomp_py.innermodel.axes import Array
from robocomp_py.innermodel.pictures import Pixels
from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.drawing import chosen
from robocomp_py.sim.render import Renderer
from robocomp_py.sim.world import World

from .scenes import WEDGE

tool = pytest.mark.tool  # of those that draw

COLOURS = {"red": "#ff0000", "green": "#00ff00", "blue": "#0000ff", "yellow": "#ffff00", "pink": "#ff00ff"}

ROOM = f"""\
<innerModel>
  <transform id="world">
    <plane id="ahead" pz="3000" nz="-1" size="9000,9000,0.002" texture="{COLOURS["yellow"]}"/>
    <plane id="behind" pz="-3500" nz="1" size="9000,9000,0.002"/>
    <plane id="right" px="2000" nx="-1" size="9000,9000,0.002" texture="{COLOURS["red"]}"/>
    <plane id="left" px="-2500" nx="1" size="9000,9000,0.002" texture="{COLOURS["green"]}"/>
    <plane id="ceiling" py="1500" ny="-1" size="9000,9000,0.002" texture="{COLOURS["blue"]}"/>
    <plane id="floor" py="-1000" ny="1" size="9000,9000,0.002" texture="{COLOURS["pink"]}"/>
    <differentialrobot id="base">
      <joint id="neck" axis="x"><rgbd id="eye" width="96" height="64" focal="40" noise="0"/></joint>
    </differentialrobot>
  </transform>
</innerModel>
"""
WALLS = ((0, 2000), (0, -2500), (1, 1500), (1, -1000), (2, 3000), (2, -3500))
"""The axis and the place of each wall, mm."""


def world(folder: Path, text: str = ROOM, **options: float) -> World:
    path = folder / "room.xml"
    path.write_text(text)
    return World(Tree.read(path), **options)  # type: ignore[arg-type]


@pytest.fixture
def room(tmp_path: Path) -> World:
    return world(tmp_path)


@pytest.fixture
def renderer() -> Iterator[Renderer]:
    with Renderer() as made:
        yield made


def colour(pixels: Pixels, row: int, column: int) -> str:
    """The name of the nearest colour, whatever the light."""
    seen = pixels[row, column].astype(float)
    if not seen.any():
        return "black"
    bright = seen / seen.max()
    known = {name: np.frombuffer(bytes.fromhex(text[1:]), np.uint8) / 255 for name, text in COLOURS.items()}
    known["grey"] = np.ones(3)
    return min(known, key=lambda name: float(np.abs(known[name] - bright).sum()))


@tool
def test_what_is_on_the_right_is_drawn_on_the_right(room: World, renderer: Renderer) -> None:
    pixels = renderer.picture(room.view(), "eye").colours
    assert pixels.shape == (64, 96, 3)
    assert [colour(pixels, 32, column) for column in (2, 48, 93)] == ["green", "yellow", "red"]
    assert [colour(pixels, row, 48) for row in (2, 32, 61)] == ["blue", "yellow", "pink"]
    room.drive("base", turn=math.pi / 2)
    room.step(200)
    assert colour(renderer.picture(room.view(), "eye").colours, 32, 48) == "red"


@tool
@pytest.mark.parametrize(("turn", "nod"), [(0.0, 0.0), (0.4, -0.3), (2.9, 0.7), (-1.3, -1.2)])
def test_every_pixel_is_as_far_along_z_as_geometry_says(
    turn: float, nod: float, room: World, renderer: Renderer
) -> None:
    room.drive("base", ahead=200, turn=turn)
    room.step(200)
    room.move_joint("neck", nod)
    pose = room.matrix("eye")
    columns, rows = np.meshgrid(np.arange(96) + 0.5, np.arange(64) + 0.5)
    rays = np.stack(((columns - 48) / 40, (32 - rows) / 40, np.ones_like(rows)), axis=-1) @ pose[:3, :3].T
    wanted = np.full(rows.shape, np.inf)
    for axis, place in WALLS:
        with np.errstate(divide="ignore"):
            depth = (place - pose[axis, 3]) / rays[..., axis]
        wanted = np.where(depth > 0, np.minimum(wanted, depth), wanted)
    seen = renderer.picture(room.view(), "eye").depths
    assert np.abs(seen * 1000 - wanted).max() < 1.0


CROWD = """\
<innerModel>
  <transform id="world">
    <differentialrobot id="base">
      <rgbd id="wide" width="40" height="30" focal="12"/><rgbd id="narrow" width="16" height="50" focal="40"/>
    </differentialrobot>
    {things}
  </transform>
</innerModel>
"""


@tool
def test_all_that_is_in_sight_is_drawn_wherever_a_camera_looks(tmp_path: Path, renderer: Renderer) -> None:
    """Shapes on all sides, some of them so long that their middles are out of sight, against rays of MuJoCo."""
    chosen, things = random.Random(3), []
    (tmp_path / "wedge.obj").write_text(WEDGE)
    for number in range(90):
        x, y, z = (chosen.uniform(-4000, 4000) for _ in range(3))
        turn = " ".join(f'r{axis}="{chosen.uniform(-3, 3)}"' for axis in "xyz")
        size = ",".join(f"{chosen.choice((150, 400, 9000 * (number % 9 == 0) + 150))}" for _ in range(3))
        shape = f'<plane id="box{number}" size="{size}"/>'
        if number % 5 == 0:
            shape = f'<mesh id="mesh{number}" file="wedge.obj" scale="{chosen.uniform(2, 6)}"/>'
        if math.hypot(x, y, z) > 900:
            things.append(f'<transform id="at{number}" tx="{x}" ty="{y}" tz="{z}" {turn}>{shape}</transform>')
    room = world(tmp_path, CROWD.format(things="".join(things)))
    for _ in range(8):
        room.drive("base", turn=0.8)
        room.step(200)
        for camera in ("wide", "narrow"):
            seen, cast = renderer.picture(room.view(), camera).depths, depths_by_rays(room, camera)
            assert np.array_equal(np.isnan(seen), np.isnan(cast))
            assert np.nanmax(np.abs(seen - cast)) < 1e-3


def depths_by_rays(room: World, camera: str) -> Array:
    """What a ray through the middle of each pixel hits, m."""
    view, lens, pose = room.view(), room.lens(camera), room.matrix(camera)
    model, data = view.scene.model, mujoco.MjData(view.scene.model)
    data.qpos[:] = view.positions
    mujoco.mj_kinematics(model, data)
    columns, rows = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    ahead = np.ones_like(rows)
    rays = np.stack(((columns - lens.width / 2) / lens.focal, (lens.height / 2 - rows) / lens.focal, ahead), axis=-1)
    lengths = np.linalg.norm(rays, axis=-1)
    along = axes.position_to_simulation((rays / lengths[..., None]).reshape(-1, 3) @ pose[:3, :3].T) * 1000
    found, hit = np.empty(along.shape[0]), np.empty(along.shape[0], np.int32)
    start, count = axes.position_to_simulation(pose[:3, 3]), len(along)
    mujoco.mj_multiRay(model, data, start, along.ravel(), None, True, -1, hit, found, None, count, 1000.0)
    made: Array = np.where(hit < 0, np.nan, found).reshape(rows.shape) / lengths
    return made


@tool
def test_where_there_is_nothing_there_is_no_depth(tmp_path: Path, renderer: Renderer) -> None:
    room = world(
        tmp_path,
        '<innerModel><plane id="wall" pz="2000" px="1000" size="2000,9000,0.002"/>'
        '<rgbd id="eye" width="20" height="10" focal="10"/></innerModel>',
    )
    colours, depths = renderer.picture(room.view(), "eye")
    assert np.isnan(depths[:, :10]).all()
    assert (colours[:, :10] == 0).all()
    assert depths[:, 10:] == pytest.approx(2.0, abs=1e-3)


@tool
def test_pictures_are_written_to_arrays_that_are_given(room: World, renderer: Renderer) -> None:
    colours, depths = np.zeros((64, 96, 3), np.uint8), np.zeros((64, 96), np.float32)
    made = renderer.picture(room.view(), "eye", colours, depths)
    assert made.colours is colours
    assert made.depths is depths
    assert colours.any()
    assert depths.all()


@tool
def test_a_view_stays_as_it_was(room: World, renderer: Renderer) -> None:
    before = room.view()
    room.drive("base", turn=1.0)
    room.step(200)
    assert colour(renderer.picture(before, "eye").colours, 32, 48) == "yellow"
    assert colour(renderer.picture(room.view(), "eye").colours, 32, 48) != "yellow"
    assert colour(renderer.picture(before, "eye").colours, 32, 48) == "yellow"


@tool
def test_a_change_of_the_scene_is_in_the_next_picture(room: World, renderer: Renderer) -> None:
    renderer.picture(room.view(), "eye")
    before, tree = room.view(), room.tree.copy()
    tree.add("base", "plane", "board", pz=500.0, size=(9000.0, 9000.0, 1.0), texture=COLOURS["pink"])
    room.change(tree)
    assert colour(renderer.picture(room.view(), "eye").colours, 32, 48) == "pink"
    assert colour(renderer.picture(before, "eye").colours, 32, 48) == "yellow"


@tool
def test_meshes_that_the_world_leaves_out_are_not_drawn(tmp_path: Path, renderer: Renderer) -> None:
    text = ROOM.replace("<joint", '<mesh id="cup" file="cup.stl" tz="500"/><joint')
    room = world(tmp_path, text, without_meshes=True)
    assert colour(renderer.picture(room.view(), "eye").colours, 32, 48) == "yellow"


# What is on planes.

QUARTERS = np.array([["red", "green"], ["blue", "yellow"]])


def quarters(size: int) -> Pixels:
    """Red is up on the left, green beside it, blue and yellow below."""
    made = np.array([[list(bytes.fromhex(COLOURS[name][1:])) for name in row] for row in QUARTERS], np.uint8)
    return np.kron(made, np.ones((size // 2, size // 2, 1), np.uint8)).astype(np.uint8)


CUBE = """\
<innerModel>
  <plane id="cube" size="1000,800,600" texture="quarters.png"/>
  <transform id="orbit" {turn}><translation id="away" tz="-2000"><rgbd id="eye" width="40" height="40" focal="60"/>
  </translation></transform>
</innerModel>
"""


@tool
@pytest.mark.parametrize(
    "turn", ['ry="0"', 'ry="1.5708"', 'ry="3.1416"', 'ry="-1.5708"', 'rx="1.5708"', 'rx="-1.5708"']
)
def test_each_side_of_a_plane_shows_its_picture_upright(turn: str, tmp_path: Path, renderer: Renderer) -> None:
    from PIL import Image

    Image.fromarray(quarters(64)).save(tmp_path / "quarters.png")
    room = world(tmp_path, CUBE.format(turn=turn))
    pixels = renderer.picture(room.view(), "eye").colours
    assert [[colour(pixels, row, column) for column in (15, 25)] for row in (15, 25)] == QUARTERS.tolist()


@tool
@pytest.mark.parametrize("content", [None, b"nothing of a picture"])
def test_a_plane_whose_picture_cannot_be_read_is_grey(
    content: bytes | None, tmp_path: Path, renderer: Renderer, caplog: pytest.LogCaptureFixture
) -> None:
    if content:
        (tmp_path / "quarters.png").write_bytes(content)
    room = world(tmp_path, CUBE.format(turn=""))
    with caplog.at_level(logging.WARNING):
        assert colour(renderer.picture(room.view(), "eye").colours, 20, 20) == "grey"
    (said,) = (each.getMessage() for each in caplog.records if each.name == "robocomp.sim")
    assert "quarters.png" in said


_EFFECT = """<effect id="{0}"><profile_COMMON><technique sid="common"><lambert><diffuse><color>{1} 1</color></diffuse>
</lambert></technique></profile_COMMON></effect>"""
_MATERIAL = '<material id="m{0}"><instance_effect url="#{0}"/></material>'
_BOUND = '<instance_material symbol="{0}" target="#m{0}"/>'
_FACES = """<triangles count="1" material="{0}"><input semantic="VERTEX" source="#points" offset="0"/><p>{1}</p>
</triangles>"""

TENTS = {
    "tent.mtl": "newmtl left\nKd 1 0 0\nnewmtl right\nKd 0 0 1\n",
    "tent.obj": "mtllib tent.mtl\nv 0 -500 0\nv 0 500 0\nv -500 0 -500\nv 500 0 -500\nv 500 -500 0\n"
    "usemtl left\nf 1 2 3\nusemtl right\nf 1 4 2\nf 1 1 5\n",
    "tent.ply": "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nproperty uchar red\nproperty uchar green\n"
    "property uchar blue\nend_header\n0 -500 0\n0 500 0\n-500 0 -500\n500 0 -500\n3 0 1 2 255 0 0\n3 0 3 1 0 0 255\n",
    "tent.dae": '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>'
    + "<library_effects>"
    + _EFFECT.format("left", "1 0 0")
    + _EFFECT.format("right", "0 0 1")
    + "</library_effects><library_materials>"
    + "".join(map(_MATERIAL.format, ("left", "right")))
    + """</library_materials><library_geometries><geometry id="tent"><mesh><source id="numbers">
    <float_array id="array" count="12">0 -500 0 0 500 0 -500 0 -500 500 0 -500</float_array><technique_common>
    <accessor source="#array" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
    <param name="Z" type="float"/></accessor></technique_common></source>
    <vertices id="points"><input semantic="POSITION" source="#numbers"/></vertices>"""
    + _FACES.format("left", "0 1 2")
    + _FACES.format("right", "0 3 1")
    + """</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="scene"><node>
    <instance_geometry url="#tent"><bind_material><technique_common>"""
    + "".join(map(_BOUND.format, ("left", "right")))
    + """</technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
    <scene><instance_visual_scene url="#scene"/></scene></COLLADA>""",
}
"""A red and a blue triangle whose edges meet ahead, in several formats."""


@tool
@pytest.mark.parametrize("scale", ["1", "1,-1,1"])
@pytest.mark.parametrize("ending", ["obj", "ply", "dae"])
def test_a_mesh_has_the_colours_of_its_file(ending: str, scale: str, tmp_path: Path, renderer: Renderer) -> None:
    for name, text in TENTS.items():
        (tmp_path / name).write_text(text)
    room = world(
        tmp_path,
        f'<innerModel><mesh id="tent" file="tent.{ending}" tz="1000" scale="{scale}"/>'
        '<rgbd id="eye" width="40" height="40" focal="30"/></innerModel>',
    )
    pixels = renderer.picture(room.view(), "eye").colours
    assert [colour(pixels, 20, column) for column in (14, 25)] == ["red", "blue"]


SCREEN = """\
<innerModel>
  <display id="screen" pz="1000" size="1000,1000,10" texture="#ff0000"/>
  <camera id="eye" width="40" height="40" focal="30"/>
</innerModel>
"""


@tool
def test_a_display_shows_what_it_was_told_last(tmp_path: Path, renderer: Renderer) -> None:
    room = world(tmp_path, SCREEN)

    def seen() -> list[list[str]]:
        pixels = renderer.picture(room.view(), "eye").colours
        return [[colour(pixels, row, column) for column in (15, 25)] for row in (15, 25)]

    assert seen() == [["red", "red"], ["red", "red"]]
    before = room.digest()
    picture = quarters(64)
    room.show("screen", picture)
    assert room.digest() != before
    picture[:] = 0  # it was copied
    assert seen() == QUARTERS.tolist()
    room.show("screen", quarters(64)[:, ::-1])
    assert seen() == QUARTERS[:, ::-1].tolist()
    room.show("screen", quarters(8)[::-1])  # of another size
    assert seen() == QUARTERS[::-1].tolist()
    other = room.copy()
    other.show("screen", None)
    assert seen() == QUARTERS[::-1].tolist()
    room.reset()
    assert seen() == [["red", "red"], ["red", "red"]]


@pytest.mark.parametrize(
    ("pixels", "text"),
    [
        (np.zeros((4, 4), np.uint8), "has uint8 of"),
        (np.zeros((4, 4, 3)), "has uint8 of"),
        (np.zeros((0, 4, 3), np.uint8), "has uint8 of"),
        (np.zeros((1, 5000, 3), np.uint8), "at most 2048 rows and columns"),
    ],
)
def test_a_display_refuses_what_is_no_picture(pixels: Pixels, text: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=text):
        world(tmp_path, SCREEN).show("screen", pixels)
    with pytest.raises(InnerModelError, match="unknown display `eye`; known: screen"):
        world(tmp_path, SCREEN).show("eye", quarters(4))


AXES = """\
<innerModel>
  <plane id="wall" pz="3000" size="9000,9000,10" texture="#ffff00"/>
  <transform id="mark" tz="1000"><axes id="frame" length="600" width="100"/></transform>
  <camera id="eye" width="40" height="40" focal="20"/>
</innerModel>
"""


@tool
def test_axes_are_drawn_and_touch_nothing(tmp_path: Path, renderer: Renderer) -> None:
    room = world(tmp_path, AXES)
    colours, depths = renderer.picture(room.view(), "eye")
    assert [colour(colours, row, column) for row, column in ((20, 28), (11, 20), (20, 10))] == [
        "red",
        "green",
        "yellow",
    ]
    assert depths[20, 28] == pytest.approx(0.95, abs=1e-3)
    assert room.view().scene.shapes == ("wall",)


# Noise, and what goes wrong.


@tool
def test_noise_is_a_factor_of_the_depth(room: World, renderer: Renderer) -> None:
    exact = renderer.picture(room.view(), "eye")
    room.set_noise("eye", 0.02)
    one, again = (renderer.picture(room.view(), "eye") for _ in range(2))
    assert (one.depths == again.depths).all()
    assert (one.colours == exact.colours).all()
    assert np.std(one.depths / exact.depths - 1) == pytest.approx(0.02, rel=0.05)
    room.step()
    assert (renderer.picture(room.view(), "eye").depths != one.depths).any()


def test_a_camera_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(InnerModelError, match="unknown camera `eyes`; did you mean `eye`"):
        world(tmp_path).lens("eyes")


@pytest.mark.parametrize("wrong", ['focal="0"', 'focal="40" height="5000"'])
def test_a_camera_that_can_take_no_picture_is_refused(wrong: str, tmp_path: Path) -> None:
    text = ROOM.replace('height="64" focal="40"', wrong if "height" in wrong else f'height="64" {wrong}')
    with pytest.raises(InnerModelError, match="`eye`: a camera needs `width` and `height` from 1 to 4096"):
        world(tmp_path, text)


def test_a_camera_without_a_width_is_off(tmp_path: Path) -> None:
    assert world(tmp_path, ROOM.replace('width="96"', "")).cameras == []


@pytest.mark.parametrize(
    ("wanted", "egl", "osmesa", "found"),
    [("", True, True, "egl"), ("", False, True, "osmesa"), ("osmesa", True, True, "osmesa"), ("glfw", 1, 1, "egl")],
)
def test_egl_is_preferred_unless_osmesa_is_wanted(wanted: str, egl: bool, osmesa: bool, found: str) -> None:
    assert chosen(wanted, lambda: egl, lambda: osmesa) == found


def test_without_opengl_the_package_of_the_system_is_named() -> None:
    with pytest.raises(ConfigurationError, match=r"apt-get install libegl1\)\. Everything else of a scene works"):
        chosen("", lambda: False, lambda: False)


_DRAW = """
import hashlib, sys
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.render import Renderer
from robocomp_py.sim.world import World
with Renderer() as renderer:
    made = renderer.picture(World(Tree.read(sys.argv[1])).view(), "eye")
print(hashlib.sha256(made.colours.tobytes() + made.depths.tobytes()).hexdigest())
"""


@tool
def test_egl_and_osmesa_draw_the_same(room: World, renderer: Renderer, tmp_path: Path) -> None:
    made = renderer.picture(room.view(), "eye")
    here = hashlib.sha256(made.colours.tobytes() + made.depths.tobytes()).hexdigest()
    other = "egl" if os.environ["MUJOCO_GL"] == "osmesa" else "osmesa"
    environment = {**os.environ, "MUJOCO_GL": other}
    environment.pop("PYOPENGL_PLATFORM")
    said = subprocess.run(
        [sys.executable, "-c", _DRAW, str(tmp_path / "room.xml")],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert said.stdout.strip() == here, said.stderr


def test_an_opengl_that_is_named_and_not_there_is_told_by_a_component(tmp_path: Path) -> None:
    (tmp_path / "OpenGL").mkdir()
    (tmp_path / "OpenGL" / "__init__.py").write_text("raise AttributeError('as PyOpenGL does without a library')")
    environment = {**os.environ, "MUJOCO_GL": "egl", "PYTHONPATH": str(tmp_path)}
    environment.pop("PYOPENGL_PLATFORM", None)
    said = subprocess.run(
        [sys.executable, "-c", "import robocomp_py.sim.serve.simulator"],
        env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert "ConfigurationError: MUJOCO_GL=egl names an OpenGL that this machine does not have" in said.stderr


def test_an_opengl_that_mujoco_does_not_know_is_told_by_a_component() -> None:
    environment = {**os.environ, "MUJOCO_GL": "vulkan"}
    said = subprocess.run(
        [sys.executable, "-c", "import robocomp_py.sim.serve.simulator"],
        env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert "ConfigurationError: MUJOCO_GL=vulkan names an OpenGL that this machine does not have" in said.stderr
