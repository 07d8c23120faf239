"""The editor on pages, visited by programs."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from robocomp_py.cli.replacing import replace_file
from robocomp_py.innermodel.axes import Array
from robocomp_py.sim.view.desk import Desk
from robocomp_py.sim.view.editor import Editor
from robocomp_py.sim.view.page import Page
from tests.sim.view.test_page import rewritten
from tests.sim.view.test_shapes import CUP
from tests.sim.view.visitor import Visitor, visiting

SCENE = """\
<innerModel>
  <transform id="world">
    <transform id="shelf" tx="1000"><plane id="board" py="500" size="600,20,300"/></transform>
    <joint id="arm" axis="y" min="-1"/>
  </transform>
</innerModel>
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "cup.obj").write_text(CUP)
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    return path


@contextmanager
def edited(scene: Path, told: list[str] | None = None) -> Iterator[tuple[Page, Desk]]:
    with Page("a scene") as page:
        yield page, Desk(page, Editor(scene, replace_file), [].append if told is None else told.append)


def board(visitor: Visitor) -> Array:
    (found,) = (each for each in visitor.shown("Box") if each["dimensions"][1] == 0.6)
    where: Array = found["where"]
    return where


def test_a_scene_is_edited_and_saved(scene: Path) -> None:
    with edited(scene) as (page, _), visiting(page.url) as visitor:
        # pick
        visitor.awaits(lambda: visitor.field("Save") and visitor.shown("Box"))
        assert visitor.field("Save")["disabled"]
        visitor.click(visitor.shown("Box")[0]["name"])
        visitor.awaits(lambda: visitor.value("node") == "board" and visitor.value("size") == "600,20,300")
        visitor.set("Select parent", True)
        visitor.awaits(lambda: visitor.value("node") == "shelf" and visitor.value("tx") == "1000")
        # drag: 0.5 m to the left
        pose = visitor.shown("TransformControls")[0]["where"]
        pose[1, 3] += 0.50004
        visitor.drag(pose)
        visitor.awaits(lambda: visitor.value("tx") == "500")
        visitor.awaits(lambda: board(visitor)[:3, 3] == pytest.approx((0, -0.5, 0.5)))
        # field
        visitor.set("node", "board")
        visitor.set("size", "600,30,300")
        visitor.awaits(lambda: visitor.shown("Box")[0]["dimensions"][2] == 0.03)
        visitor.set("texture", "#ff0000")
        visitor.awaits(lambda: tuple(visitor.shown("Box")[0]["color"]) == (255, 0, 0))
        # a plane and a mesh
        visitor.set("Add plane", True)
        visitor.awaits(lambda: visitor.value("node") == "plane1" and len(visitor.shown("Box")) == 2)
        visitor.set("mesh file", "cup.obj")
        visitor.set("Add mesh", True)
        visitor.awaits(lambda: visitor.value("node") == "mesh1" and visitor.shown("Mesh"))
        # undo and redo
        visitor.set("Undo", True)
        visitor.awaits(lambda: not visitor.shown("Mesh") and not visitor.field("Redo")["disabled"])
        visitor.set("Undo", True)
        visitor.awaits(lambda: len(visitor.shown("Box")) == 1)
        visitor.set("Redo", True)
        visitor.awaits(lambda: len(visitor.shown("Box")) == 2 and visitor.field("state")["value"].endswith("not saved"))
        # save
        visitor.set("Save", True)
        visitor.awaits(lambda: visitor.value("state") == "scene.xml: saved")
    lines = SCENE.replace('tx="1000"', 'tx="500"').replace(
        'size="600,20,300"/>',
        'size="600,30,300" texture="#ff0000"/>\n'
        '      <plane id="plane1" texture="#b0a080" size="500,500,500" py="250"/>\n    ',
    )
    assert "".join(scene.read_text().split()) == "".join(lines.split())


def test_what_is_wrong_is_told_and_changes_nothing(scene: Path) -> None:
    with edited(scene) as (page, desk), visiting(page.url) as visitor:
        visitor.set("node", "arm")
        visitor.set("min", "low")
        visitor.awaits(lambda: "`min` is `low`, which is no number" in visitor.value("state"))
        assert visitor.value("min") == "low"  # what is typed stays
        visitor.set("min", "-0.5")
        visitor.awaits(lambda: desk.editor.tree.node("arm").values["min"] == -0.5)
        visitor.set("axis", "x")
        visitor.awaits(lambda: desk.editor.tree.node("arm").values["axis"] == "x")
        visitor.set("mesh file", "nowhere.obj")
        visitor.set("Add mesh", True)
        visitor.awaits(lambda: "there is no file `nowhere.obj`" in visitor.value("state"))
        visitor.set("node", "world")
        visitor.set("Remove", True)
        visitor.awaits(lambda: visitor.shown("Box") == [])
        visitor.set("Undo", True)
        visitor.awaits(lambda: len(visitor.shown("Box")) == 1)


def test_one_page_edits_and_the_next_one_does_when_it_is_closed(scene: Path) -> None:
    with edited(scene) as (page, _), visiting(page.url) as first:
        first.awaits(lambda: first.field("Save"))
        with visiting(page.url) as other:
            other.awaits(lambda: other.value("state") == "read only: another page edits this scene")
            other.awaits(lambda: other.shown("Box"))
            assert not other.field("Save")
            other.click(other.shown("Box")[0]["name"])
            other.awaits(lambda: "plane board" in other.value("node"))
            assert first.value("node") == "(none)"
            first.close()
            other.awaits(lambda: other.field("Save"))
            other.set("node", "board")
            other.awaits(lambda: other.value("size") == "600,20,300")


def test_a_file_that_something_else_changes_is_told_and_not_overwritten(scene: Path) -> None:
    told: list[str] = []
    is_ended = threading.Event()
    with edited(scene, told) as (page, desk), visiting(page.url) as visitor:
        thread = threading.Thread(target=desk.follow, args=(is_ended, 0.01), name="follow")
        thread.start()
        try:
            visitor.awaits(lambda: visitor.shown("Box"))
            # without edits, it is read again
            rewritten(scene, SCENE.replace('py="500"', 'py="700"'))
            visitor.awaits(lambda: board(visitor)[2, 3] == pytest.approx(0.7))
            # with edits, they stay
            visitor.set("node", "shelf")
            visitor.set("tx", "250")
            visitor.awaits(lambda: board(visitor)[1, 3] == pytest.approx(-0.25))
            other = SCENE.replace('py="500"', 'py="900"')
            rewritten(scene, other)
            visitor.awaits(lambda: "was changed on disk" in visitor.value("state"))
            visitor.set("Save", True)
            visitor.awaits(lambda: "nothing is written" in visitor.value("state"))
            assert scene.read_text() == other
            visitor.set("Save a copy", True)
            visitor.awaits(lambda: visitor.value("state") == "saved as scene-2.xml")
            visitor.set("Reload", True)
            visitor.awaits(lambda: board(visitor)[:3, 3] == pytest.approx((0, -1, 0.9)))
        finally:
            is_ended.set()
            thread.join()
    assert 'tx="250"' in scene.with_name("scene-2.xml").read_text()
    assert told[0] == "scene.xml: read again"
