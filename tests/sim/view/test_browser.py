"""The pages of scenes in Chromium."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
import viser.transforms
from PIL import Image

from robocomp_py.cli.replacing import replace_file
from robocomp_py.innermodel.axes import Array
from robocomp_py.innermodel.tree import Tree
from robocomp_py.sim.view.desk import Desk
from robocomp_py.sim.view.editor import Editor
from robocomp_py.sim.view.page import Page
from robocomp_py.sim.view.shapes import Cloud
from robocomp_py.sim.view.viewing import FileShow
from robocomp_py.testing.patience import SOON, wait_until
from tests.browser import Browser, browsing
from tests.sim.view.test_shapes import CUP

SCENE = """\
<innerModel>
  <transform id="world">
    <transform id="shelf" tx="500"><plane id="board" py="500" size="600,300,300" texture="#ff0000"/></transform>
    <plane id="post" px="-1200" size="300,300,300" texture="#0000ff"/>
  </transform>
</innerModel>
"""

MORE = """\
  <transform id="mark" tx="500" ty="-600"><axes id="frame" length="400" width="100"/></transform>
  <transform id="head" tx="-400" ty="300"><pointcloud id="seen"/></transform>
</innerModel>
"""


class Eyes:
    """What the only page sees, by its own camera."""

    def __init__(self, page: Page) -> None:
        wait_until(page.server.get_clients, SOON * 6, "no page")
        (client,) = page.server.get_clients().values()
        self._camera = client.camera

    def pixel(self, point: Any) -> list[float]:
        """The column and row at which a point of the page is seen."""
        camera, (x, y, z) = self._camera, self._seen(point)
        return [camera.image_width / 2 + self._focal * x / z, camera.image_height / 2 + self._focal * y / z]

    def length(self, pixels: float, point: Any) -> float:
        """The length of what has so many pixels where a point is, m."""
        return float(pixels * self._seen(point)[2] / self._focal)

    @property
    def _focal(self) -> float:
        return float(self._camera.image_height / 2 / np.tan(self._camera.fov / 2))

    def _seen(self, point: Any) -> Any:
        turn = viser.transforms.SO3(np.array(self._camera.wxyz)).as_matrix()
        return turn.T @ (np.array(point) - self._camera.position)


def colours(browser: Browser, folder: Path) -> Array:
    """The picture of the page, shape (height, width, 3)."""
    browser(picture=str(folder / "page.png"))
    with Image.open(folder / "page.png") as picture:
        return np.asarray(picture.convert("RGB")).astype(float)


def is_red(pixel: Array) -> bool:
    return bool(pixel[0] > 1.5 * pixel[2])


def button(label: str) -> str:
    """A script that presses a button, once it can be pressed."""
    found = f"[...document.querySelectorAll('button')].find(each => each.textContent === {json.dumps(label)})"
    return f"(button => button && !button.disabled && (button.click(), true))({found})"


def field(label: str) -> str:
    """A script: the element of the field with this label."""
    return (
        "(label => { while (label && !label.querySelector('input')) label = label.parentElement;"
        " return label?.querySelector('input'); })"
        f"([...document.querySelectorAll('label')].find(each => each.textContent === {json.dumps(label)}))"
    )


def value(label: str) -> str:
    """A script: the text of a field."""
    return f"{field(label)}?.value"


def only_own_requests(browser: Browser, page: Page) -> bool:
    own = f"http://{urlsplit(page.url).netloc}/"
    return all(each.startswith((own, "data:", f"blob:{own}")) for each in browser(requests=True))


@pytest.mark.tool
@pytest.mark.timeout(600)
def test_the_page_shows_the_scene_and_asks_nothing_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(SCENE)
    with Page("a scene") as page:
        show = FileShow(page, tmp_path / "scene.xml", print)
        with browsing(tmp_path, page.url) as browser:
            browser(width=1200)
            eyes = Eyes(page)

            def is_seen() -> bool:
                picture = colours(browser, tmp_path)
                board, post = (picture[round(y), round(x)] for x, y in map(eyes.pixel, ((0, -0.5, 0.5), (0, 1.2, 0))))
                return is_red(board) and post[2] > 1.5 * post[0]  # right is right, left is left

            wait_until(is_seen, SOON * 6)
            x, y = eyes.pixel((0, -0.5, 0.5))
            browser(path=[[x, y]])
            browser(wait="document.querySelector('textarea').value.startsWith('plane board')")
            # axes, and a cloud of points
            (tmp_path / "more.xml").write_text(SCENE.replace("</innerModel>", MORE))
            points = np.random.default_rng(1).uniform(-0.1, 0.1, (3000, 3)).astype(np.float32)
            pink = np.full((3000, 3), (255, 0, 255), np.uint8)
            show.show(Tree.read(tmp_path / "more.xml"), (), {"seen": Cloud(points, pink)})

            def are_seen() -> bool:
                picture = colours(browser, tmp_path)
                places = ((0, -0.75, -0.6), (0, -0.5, -0.35), (0, 0.4, 0.3))
                x_axis, y_axis, cloud = (picture[round(y), round(x)] for x, y in map(eyes.pixel, places))
                is_green = y_axis[1] > 1.5 * y_axis[0] and y_axis[1] > 1.3 * y_axis[2]
                return is_red(x_axis) and is_green and bool(min(cloud[0], cloud[2]) > 1.5 * cloud[1])

            wait_until(are_seen, SOON * 6)
            assert browser(complaints=True) == []
            assert only_own_requests(browser, page)


@pytest.mark.tool
@pytest.mark.timeout(600)
def test_a_scene_is_edited_in_the_browser(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    (tmp_path / "cup.obj").write_text(CUP)
    with Page("a scene") as page:
        desk = Desk(page, Editor(path, replace_file), print)
        editor = desk.editor
        with browsing(tmp_path, page.url) as browser:
            browser(width=900)
            browser(
                wait="document.querySelector('canvas')?.getBoundingClientRect().right < innerWidth - 200"
            )  # the panel
            eyes = Eyes(page)

            def is_seen() -> bool:
                x, y = eyes.pixel((0, -0.5, 0.5))
                return is_red(colours(browser, tmp_path)[round(y), round(x)])

            wait_until(is_seen, SOON * 6)
            # pick
            browser(path=[eyes.pixel((0, -0.5, 0.5))])
            browser(wait=f"{value('size')} === '600,300,300'")
            browser(wait=button("Select parent"))
            browser(wait=f"{value('tx')} === '500'")
            # drag the arrow that points to the left
            wait_until(lambda: editor.selected == "shelf")
            grip = -0.5 + eyes.length(0.75 * 110, (0, -0.5, 0))
            browser(path=[eyes.pixel((0, grip + by, 0)) for by in (0.0, 0.2, 0.4)])
            wait_until(lambda: editor.can_undo, what="nothing was dragged")
            wait_until(lambda: abs(float(str(editor.tree.node("shelf").values["tx"])) - 100) < 60)
            # field, when it shows where the drag has ended
            wait_until(lambda: float(browser(wait=value("tx"))) == editor.tree.node("shelf").values["tx"], SOON * 3)
            browser(wait=f"(input => (input.id = 'meant', true))({field('tx')})")
            browser(fill=["#meant", "250"])
            wait_until(lambda: editor.tree.node("shelf").values["tx"] == 250, SOON * 3)
            # a plane and a mesh
            browser(wait=button("Add plane"))
            browser(wait=f"{value('size')} === '500,500,500'")
            browser(wait=f"(input => (input.id = 'named', true))({field('mesh file')})")
            browser(fill=["#named", "cup.obj"])
            browser(wait=button("Add mesh"))
            browser(wait=f"{value('file')} === 'cup.obj'")
            # undo, and save
            browser(wait=button("Undo"))
            wait_until(lambda: "mesh1" not in editor.tree)
            browser(wait=button("Save"))
            wait_until(lambda: editor.is_saved)
            assert browser(complaints=True) == []
            assert only_own_requests(browser, page)
    text = SCENE.replace('tx="500"', 'tx="250"').replace(
        'texture="#ff0000"/>',
        'texture="#ff0000"/>\n      <plane id="plane1" texture="#b0a080" size="500,500,500" py="250"/>\n    ',
    )
    assert "".join(path.read_text().split()) == "".join(text.split())
