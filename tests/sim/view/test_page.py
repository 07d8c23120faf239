"""Pages that show a scene, visited by a program."""

from __future__ import annotations

import http.client
import math
import os
import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
import viser.transforms
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from robocomp_py.cli.replacing import replace_file
from robocomp_py.innermodel import axes
from robocomp_py.innermodel.axes import Array
from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.sim.view.desk import Desk
from robocomp_py.sim.view.editor import Editor
from robocomp_py.sim.view.page import Page
from robocomp_py.sim.view.stage import quaternion
from robocomp_py.sim.view.viewing import FileShow
from robocomp_py.testing.patience import SOON
from tests.sim.view.visitor import visiting

SCENE = """\
<innerModel>
  <transform id="world">
    <plane id="floor" size="4000,10,4000" texture="#999999"/>
    <transform id="shelf" tx="1000"><plane id="board" py="500" size="600,20,300"/></transform>
    <mesh id="lost" file="nowhere.obj"/>
  </transform>
</innerModel>
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    return path


@contextmanager
def page() -> Iterator[Page]:
    with Page("a scene") as made:
        yield made


def rewritten(path: Path, text: str) -> None:
    """Write a file such that it is seen to be another one."""
    before = path.stat().st_mtime_ns
    path.write_text(text)
    os.utime(path, ns=(before + 10**6, before + 10**6))


@pytest.mark.parametrize(
    "angles", [(0.1, 0.2, 0.3), (math.pi, 0, 0.1), (0, math.pi, 0.1), (0.1, 0, math.pi), (3, 3, 3)]
)
def test_a_rotation_is_the_same_as_a_quaternion(angles: tuple[float, float, float]) -> None:
    turn = axes.rotation(*angles)
    assert np.allclose(viser.transforms.SO3(np.array(quaternion(turn))).as_matrix(), turn)


def test_a_scene_is_shown(scene: Path) -> None:
    told: list[str] = []
    with page() as served:
        FileShow(served, scene, told.append)
        with visiting(served.url) as visitor:
            visitor.awaits(lambda: len(visitor.shown("Box")) == 3)
            boxes = {each["dimensions"][1]: each["where"] for each in visitor.shown("Box")}
            assert boxes[0.6][:3, 3] == pytest.approx((0, -1, 0.5))
    assert told == [f"{scene}:5:5: `lost` is shown as a box: there is no file `nowhere.obj`"]


@pytest.mark.parametrize("side", [300.0, 30000.0])
def test_a_new_page_has_all_of_a_scene_in_sight_and_not_far_away(side: float, tmp_path: Path) -> None:
    (tmp_path / "floor.xml").write_text(
        f'<innerModel><plane id="floor" px="9000" size="{side},10,{side}"/></innerModel>'
    )
    with page() as served:
        FileShow(served, tmp_path / "floor.xml", print)
        camera = served.server.initial_camera
    corners = np.array([(x, y, 0) for x in (-1, 1) for y in (-1, 1)]) * side / 2000.0 + (0.0, -9.0, 0.0)
    ahead = camera.look_at - camera.position
    seen = corners - camera.position
    lengths, depths = np.linalg.norm(seen, axis=1), seen @ ahead / np.linalg.norm(ahead)
    widest = np.degrees(np.arccos(depths / lengths)).max()
    assert widest < 75.0 / 2.0
    assert widest > 25.0 or np.linalg.norm(ahead) < 2.0


def seen(camera: Any, points: Array) -> Array:
    """Where points are in the picture of a page, from -1 on the left and at the bottom to 1; shape (n, 2)."""
    ahead = camera.look_at - camera.position
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, (0, 0, 1))
    right = right / np.linalg.norm(right)
    x, y, z = np.stack((right, np.cross(right, ahead), ahead)) @ (points - camera.position).T
    height = z * np.tan(camera.fov / 2.0)
    return np.stack((x / height / camera.aspect, y / height), axis=1)


CORNERS = np.array([(x, y, 0.005) for x in (-2.0, 2.0) for y in (-2.0, 2.0)])


@pytest.fixture
def floor(tmp_path: Path) -> Path:
    path = tmp_path / "floor.xml"
    path.write_text('<innerModel><plane id="floor" size="4000,10,4000"/></innerModel>')
    return path


@pytest.mark.parametrize(
    ("kind", "size", "lowest"),
    [
        (FileShow, (1200, 700), -1.0),
        (FileShow, (600, 700), -1.0),
        (FileShow, (320, 700), -0.4),
        (Desk, (900, 700), -1.0),
        (Desk, (320, 700), 0.2),
    ],
)
def test_a_page_has_all_of_a_scene_in_sight_beside_its_panel(
    kind: type, size: tuple[int, int], lowest: float, floor: Path
) -> None:
    with page() as served:
        kind(served, Editor(floor, replace_file) if kind is Desk else floor, print)
        with visiting(served.url, size) as visitor:
            visitor.awaits(lambda: visitor.field("node"))  # then it is aimed, too
            (client,) = served.server.get_clients().values()
            places = seen(client.camera, CORNERS)
    assert places.max() < 1.0
    assert places[:, 0].min() > -1.0
    assert places[:, 1].min() > lowest
    assert max(np.ptp(places[:, 0]) / 2.0, np.ptp(places[:, 1]) / (1.0 - lowest)) > 0.6  # and it is not far away


def test_a_page_whose_window_changes_has_all_in_sight_until_its_user_looks_elsewhere(floor: Path) -> None:
    with page() as served:
        FileShow(served, floor, print)
        with visiting(served.url, (1200, 700)) as visitor:
            visitor.awaits(lambda: visitor.field("node"))
            (client,) = served.server.get_clients().values()
            wide = np.array(client.camera.position)
            visitor.look((3.0, 3.0, 3.0), (1200, 700))  # pages begin there
            visitor.look(tuple(wide.tolist()), (1200, 700))
            visitor.look(tuple(wide.tolist()), (600, 700))
            visitor.awaits(lambda: np.linalg.norm(client.camera.position) > np.linalg.norm(wide) * 1.1)
            visitor.look(tuple(client.camera.position.tolist()), (600, 700))
            visitor.look((1.0, 2.0, 3.0), (600, 700))
            visitor.look((1.0, 2.0, 3.0), (300, 700))
            visitor.awaits(lambda: client.camera.image_width == 300)
            visitor.look((1.0, 2.0, 4.0), (300, 700))  # after it, all before has been taken
            visitor.awaits(lambda: client.camera.position[2] == 4.0)
            assert client.camera.position.tolist() == [1.0, 2.0, 4.0]


def test_a_click_tells_what_a_node_is_to_the_page_that_clicked(scene: Path) -> None:
    with page() as served:
        FileShow(served, scene, print)
        with visiting(served.url) as visitor, visiting(served.url) as other:
            visitor.awaits(lambda: visitor.field("node") and other.field("node"))
            board = next(each for each in visitor.shown("Box") if each["dimensions"][1] == 0.6)
            visitor.click(board["name"])
            visitor.awaits(lambda: "board" in visitor.value("node"))
            lines = visitor.value("node").splitlines()
            assert other.value("node") == "Click something."
    assert lines == [
        "plane board",
        f"{scene}:4:37",
        "in shelf",
        "at 1000, 500, 0 mm",
        "turned 0.000, 0.000, 0.000 rad",
        "size = 600,20,300",
        "py = 500",
    ]


def test_changes_of_the_file_are_shown_and_troubles_told_once(scene: Path) -> None:
    told: list[str] = []
    with page() as served:
        show = FileShow(served, scene, told.append)
        with visiting(served.url) as visitor:
            visitor.awaits(lambda: len(visitor.shown("Box")) == 3)
            names = {each["name"] for each in visitor.shown("Box")}
            rewritten(scene, SCENE.replace('tx="1000"', 'tx="2000"'))
            show.look()
            visitor.awaits(lambda: any(each["where"][1, 3] == pytest.approx(-2) for each in visitor.shown("Box")))
            assert {each["name"] for each in visitor.shown("Box")} == names  # only moved
            assert len(told) == 1
            rewritten(scene, SCENE.replace("</transform>", "", 1))
            show.look()
            show.look()
            assert "error[syntax]" in told[1]
            assert len(told) == 2
            rewritten(scene, SCENE.replace('size="600', 'size="700'))
            show.look()
            visitor.awaits(lambda: any(each["dimensions"][1] == 0.7 for each in visitor.shown("Box")))
            assert len(visitor.shown("Box")) == 3


def test_a_broken_scene_is_not_shown(scene: Path) -> None:
    scene.write_text("<innerModel><plan id='x'/></innerModel>")
    with page() as served, pytest.raises(InnerModelError, match="did you mean"):
        FileShow(served, scene, print)


def test_a_page_is_served_only_to_those_that_know_the_token() -> None:
    with page() as served:
        parts = urlsplit(served.url)
        answers = {}
        for name, path, headers in [
            ("the page", f"/?{parts.query}", {}),
            ("no token", "/", {}),
            ("a wrong token", "/?token=x", {}),
            ("another host", f"/?{parts.query}", {"Host": "example.org"}),
            ("another origin", f"/?{parts.query}", {"Origin": "http://example.org"}),
        ]:
            with closing(http.client.HTTPConnection(parts.netloc, timeout=SOON)) as connection:
                connection.request("GET", path, headers=headers)
                with connection.getresponse() as response:
                    answers[name] = response.status
    assert answers == {
        "the page": 200,
        "no token": 403,
        "a wrong token": 403,
        "another host": 403,
        "another origin": 403,
    }


@pytest.mark.parametrize("origin", [None, "http://example.org"])
def test_a_page_from_elsewhere_cannot_connect(origin: str | None) -> None:
    with page() as served:
        parts = urlsplit(served.url)
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://{parts.netloc}/?{parts.query}", origin=origin, open_timeout=SOON)  # type: ignore[arg-type]


def test_a_port_that_is_taken_is_not_replaced_by_another() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other, pytest.raises(OSError, match="in use"):
        Page("a scene", other.getsockname()[1])
