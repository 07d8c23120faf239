"""What is shown of a scene, without a page."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.view.shapes import (
    LOST,
    Block,
    Cloud,
    Drawing,
    Eye,
    Fan,
    Gallery,
    Pictured,
    Surface,
    drawn,
    from_page,
    on_page,
)

CUP = """\
v 0 0 0
v 100 0 0
v 0 100 0
v 0 0 100
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


def shown(folder: Path, inner: str, *carriers: str) -> Drawing:
    path = folder / "scene.xml"
    path.write_text(f"<innerModel>{inner}</innerModel>")
    return drawn(Tree.read(path), Gallery(), carriers)


def test_a_box_that_is_right_of_the_origin_is_right_of_it_on_the_page(tmp_path: Path) -> None:
    (box,) = shown(tmp_path, '<plane id="box" px="1000" py="500" size="300,200,100" texture="#ff8000"/>').shapes
    assert box.form == Block((0.1, 0.3, 0.2), (255, 128, 0))
    assert box.pose[:3, 3] == pytest.approx((0, -1, 0.5))  # X is ahead, Y left, Z up


def test_a_turn_to_the_right_is_one_on_the_page(tmp_path: Path) -> None:
    (box,) = shown(tmp_path, f'<transform id="t" ry="{math.pi / 2}"><plane id="box"/></transform>').shapes
    assert box.pose[:3, :3] @ (1, 0, 0) == pytest.approx((0, -1, 0))


def test_poses_lead_there_and_back() -> None:
    matrix = Tree().matrix("root", "root")
    matrix[:3, 3] = 1.0, 2.0, 3.0
    assert np.allclose(from_page(on_page(matrix)), matrix)


def test_what_moves_is_shown_in_what_carries_it(tmp_path: Path) -> None:
    inner = '<joint id="arm" tx="700"><translation id="out" tz="200"><plane id="hand"/></translation></joint>'
    hand, wall = shown(tmp_path, f'{inner}<plane id="wall"/>', "arm").shapes
    assert (hand.carrier, wall.carrier) == ("arm", "root")
    assert hand.pose[:3, 3] == pytest.approx((0.2, 0, 0))


def test_a_picture_is_shown_and_read_again_when_it_changes(tmp_path: Path) -> None:
    Image.new("RGB", (4, 2), (9, 8, 7)).save(tmp_path / "a.png")
    inner = '<plane id="poster" texture="a.png" size="400,200,10"/>'
    form = shown(tmp_path, inner).shapes[0].form
    assert isinstance(form, Pictured)
    assert (form.size, form.path.name) == ((400, 200, 10), "a.png")
    gallery = Gallery()
    pixels = gallery.picture(form.path, form.stamp)
    assert not isinstance(pixels, str)
    assert pixels[0, 0].tolist() == [9, 8, 7]


@pytest.mark.parametrize("text", [None, "no picture"])
def test_a_plane_whose_picture_cannot_be_read_is_grey(tmp_path: Path, text: str | None) -> None:
    if text:
        (tmp_path / "a.png").write_text(text)
    drawing = shown(tmp_path, '<plane id="poster" texture="a.png"/>')
    assert isinstance(drawing.shapes[0].form, Block)
    assert drawing.shapes[0].form.colour == (128, 128, 128)
    assert f"{tmp_path}/scene.xml:1:13: `poster` is grey: " in drawing.troubles[0]


def test_a_mesh_is_read_from_its_file(tmp_path: Path) -> None:
    (tmp_path / "cup.obj").write_text(CUP)
    form = shown(tmp_path, '<mesh id="cup" file="cup.obj" scale="2" render="wireframe"/>').shapes[0].form
    assert isinstance(form, Surface)
    assert (form.scale, form.is_wireframe) == ((2,), True)


@pytest.mark.parametrize(("name", "why"), [("cup.obj", "there is no file"), ("cup.ive", "osgconv"), ("cup.ply", "")])
def test_a_mesh_that_cannot_be_read_is_a_box(tmp_path: Path, name: str, why: str) -> None:
    if name != "cup.obj":
        (tmp_path / name).write_text("broken")
    drawing = shown(tmp_path, f'<mesh id="cup" file="{name}"/>')
    assert isinstance(drawing.shapes[0].form, Block)
    assert drawing.shapes[0].form.colour == LOST
    assert "`cup` is shown as a box: " in drawing.troubles[0]
    assert why in drawing.troubles[0]


def test_sensors_are_shown(tmp_path: Path) -> None:
    inner = (
        '<transform id="t"><laser id="l" angle="3" measures="5"/><camera id="c" width="80" height="60" focal="30"/>'
        '<camera id="off"/><axes id="a" length="100" width="10"/><imu id="i"/></transform>'
    )
    laser, camera, *arrows = shown(tmp_path, inner).shapes
    assert laser.form == Fan(3)
    assert isinstance(camera.form, Eye)
    assert camera.form == pytest.approx((math.pi / 2, 80 / 60))
    assert camera.pose[:3, 2] == pytest.approx((1, 0, 0))  # it looks ahead
    assert camera.pose[:3, 1] == pytest.approx((0, 0, -1))
    assert np.linalg.det(camera.pose[:3, :3]) == pytest.approx(1)
    tips = [each.pose[:3, 3].round(9).tolist() for each in arrows]
    assert tips == [[0, -0.05, 0], [0, 0, 0.05], [0.05, 0, 0]]


def test_the_points_of_a_cloud_move_with_what_carries_it(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    inner = '<joint id="arm"><translation id="out" tz="200"><pointcloud id="seen"/></translation></joint>'
    path.write_text(f'<innerModel>{inner}<pointcloud id="empty"/></innerModel>')
    cloud = Cloud(np.zeros((5, 3), np.float32), np.zeros((5, 3), np.uint8))
    (seen,) = drawn(Tree.read(path), Gallery(), ["arm"], {"seen": cloud}).shapes
    assert (seen.node, seen.carrier, seen.form) == ("seen", "arm", cloud)
    assert seen.pose[:3, 3] == pytest.approx((0.2, 0, 0))
