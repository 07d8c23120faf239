"""The editor of a scene's file, without a page."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from robocomp_py.cli.replacing import replace_file
from robocomp_py.innermodel import axes
from robocomp_py.innermodel.axes import Array
from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.sim.view.editor import Editor, EditorError, parsed
from tests.sim.view.test_shapes import CUP

SCENE = """\
<innerModel>
  <!-- a room -->
  <transform id="world">
    <transform id = 'shelf' tx="1000.123456" ty='0' rz="0.3">
      <plane id="board" py="500" ny="1" size="600,300,20"/>
    </transform>
    <joint id="arm" tx="100" axis="y" min="-1" max="1" ><mesh id="cup" file="cup.obj"/></joint>
    <rotation id="tilt"/>  <translation id="mast"/>
    <laser id="eye" measures="5" max="100"/>
  </transform>
</innerModel>
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "cup.obj").write_text(CUP)
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def editor(scene: Path) -> Editor:
    return Editor(scene, replace_file)


def moved(editor: Editor, node: str, by: tuple[float, float, float], turn: Array | None = None) -> None:
    pose = editor.tree.matrix("root", node)
    pose[:3, 3] += by
    if turn is not None:
        pose[:3, :3] = pose[:3, :3] @ turn
    editor.place(node, pose)


def differing(scene: Path) -> list[tuple[str, str]]:
    """The lines of the file that changed, before and after."""
    return [pair for pair in zip(SCENE.splitlines(), scene.read_text().splitlines(), strict=True) if pair[0] != pair[1]]


def test_what_a_gizmo_gives_is_rounded_and_only_what_changed_is_written(editor: Editor, scene: Path) -> None:
    moved(editor, "shelf", (0.0, 250.123456, 0.00001))
    assert editor.save() == [scene]
    before = "    <transform id = 'shelf' tx=\"1000.123456\" ty='0' rz=\"0.3\">"
    assert differing(scene) == [(before, before.replace("ty='0'", "ty='250.1'"))]


def test_a_turn_changes_only_angles(editor: Editor, scene: Path) -> None:
    moved(editor, "shelf", (0, 0, 0), axes.rotation(0, 0, 0.10004))
    editor.save()
    assert [after.strip() for _, after in differing(scene)] == [
        "<transform id = 'shelf' tx=\"1000.123456\" ty='0' rz=\"0.4\">"
    ]


def test_a_pose_that_stays_changes_nothing(editor: Editor) -> None:
    for node in ("shelf", "board", "arm", "cup", "tilt", "mast", "eye", "world"):
        moved(editor, node, (0.01, -0.01, 0.0), axes.rotation(0, 0, 1e-6))
    assert editor.is_saved
    assert not editor.can_undo


def test_a_plane_is_turned_by_its_normal(editor: Editor) -> None:
    moved(editor, "board", (0, 0, 0), axes.rotation(0, 0, 1.0))  # about its normal
    assert not editor.can_undo
    moved(editor, "board", (0, 0, 0), axes.rotation(math.pi / 2, 0, 0))
    values = editor.tree.node("board").values
    assert np.linalg.norm([values["nx"], values["ny"], values["nz"]]) == pytest.approx(1, abs=1e-3)  # type: ignore[list-item]
    assert values["ny"] == 0
    assert values["py"] == 500


def test_a_joint_that_is_moved_keeps_its_turn_out_of_the_file(editor: Editor) -> None:
    editor.tree.update_joint("arm", 0.5)
    moved(editor, "arm", (0, 0, 70))
    values = editor.tree.node("arm").values
    assert (values["tx"], values["tz"], values["ry"]) == (100, 70, 0)


@pytest.mark.parametrize(("node", "attribute"), [("tilt", "ry"), ("mast", "tx")])
def test_what_only_turns_or_only_moves_does_that(editor: Editor, node: str, attribute: str) -> None:
    moved(editor, node, (10, 0, 0), axes.rotation(0, 0.2, 0))
    values = editor.tree.node(node).values
    assert {key: value for key, value in values.items() if key != "id" and value} == {
        "engine": "static",
        attribute: {"ry": 0.2, "tx": 10}[attribute],
    }


def test_attributes_are_set_as_a_file_has_them(editor: Editor, scene: Path) -> None:
    editor.set("board", "size", "700, 300,20")
    editor.set("arm", "min", "-1.5")
    editor.set("cup", "render", "wireframe")
    editor.set("board", "texture", 'a "b" & <c>')
    editor.save()
    assert [after.strip() for _, after in differing(scene)] == [
        '<plane id="board" py="500" ny="1" size="700,300,20" texture="a &quot;b&quot; &amp; &lt;c&gt;"/>',
        '<joint id="arm" tx="100" axis="y" min="-1.5" max="1" >'
        '<mesh id="cup" file="cup.obj" render="wireframe"/></joint>',
    ]


@pytest.mark.parametrize(
    ("tag", "attribute", "text", "why"),
    [
        ("transform", "tx", "left", "`tx` is `left`, which is no number"),
        ("transform", "tx", "nan", "no finite number"),
        ("transform", "tx", "", "`tx` is empty"),
        ("joint", "axis", "w", "`axis` is `x`, `y` or `z`, not `w`"),
        ("laser", "port", "70000", "whole number of at most 65535"),
        ("laser", "measures", "-1", "negative"),
        ("plane", "size", "1,2,3,4", "at most 3"),
        ("plane", "colour", "red", "has no attribute `colour`"),
        ("plane", "texture", "\x01", "invalid token"),
    ],
)
def test_a_text_that_is_no_value_is_refused(tag: str, attribute: str, text: str, why: str) -> None:
    with pytest.raises(EditorError) as refused:
        parsed(tag, attribute, text)
    assert why in str(refused.value)


def test_what_is_typed_in_a_row_is_one_step(editor: Editor) -> None:
    for text in ("7", "70", "700"):
        editor.set("shelf", "tx", text)
    editor.set("shelf", "ty", "5")
    for _ in range(2):
        editor.undo()
    assert editor.tree.node("shelf").values["tx"] == 1000.123456
    assert not editor.can_undo
    editor.redo()
    assert editor.tree.node("shelf").values["tx"] == 700
    editor.set("shelf", "tx", "1")
    assert not editor.can_redo
    editor.undo()
    assert editor.tree.node("shelf").values["tx"] == 700


def test_two_drags_are_two_steps(editor: Editor) -> None:
    moved(editor, "mast", (1, 0, 0))
    moved(editor, "mast", (1, 0, 0))
    editor.settle()
    moved(editor, "mast", (1, 0, 0))
    editor.undo()
    assert editor.tree.node("mast").values["tx"] == 2
    editor.undo()
    assert editor.tree.node("mast").values["tx"] == 0


def test_planes_and_meshes_are_added_to_what_is_selected_or_beside_it(editor: Editor, scene: Path) -> None:
    editor.select("board")
    assert editor.add_plane() == "plane1"
    assert editor.tree.parent("plane1") == "shelf"
    editor.select("")
    assert editor.add_mesh("cup.obj") == editor.selected == "mesh1"
    assert editor.tree.parent("mesh1") == "world"
    editor.save()
    text = scene.read_text()
    assert '<plane id="plane1" texture="#b0a080" size="500,500,500" py="250"/>\n    </transform>' in text
    assert '\n      <mesh id="mesh1" file="cup.obj"/>\n  </transform>' in text
    added = [line for line in text.splitlines() if "plane1" in line or "mesh1" in line]
    assert [line for line in text.splitlines() if line not in added] == SCENE.splitlines()


@pytest.mark.parametrize(
    ("file", "why"), [("", "no file"), ("nowhere.obj", "no file"), ("scene.xml", "meshes are read")]
)
def test_a_mesh_that_cannot_be_read_is_not_added(editor: Editor, file: str, why: str) -> None:
    with pytest.raises(EditorError, match=why):
        editor.add_mesh(file)
    assert not editor.can_undo


def test_nodes_are_removed_and_come_back(editor: Editor) -> None:
    editor.select("shelf")
    editor.remove("shelf")
    assert "board" not in editor.tree
    assert editor.selected == "world"
    editor.undo()
    assert editor.is_saved
    with pytest.raises(EditorError, match="the root stays"):
        editor.remove("root")
    with pytest.raises(EditorError, match="did you mean `shelf`"):
        editor.remove("shelff")


def test_after_saving_an_undone_edit_is_written_back(editor: Editor, scene: Path) -> None:
    editor.set("shelf", "tx", "5")
    editor.save()
    assert editor.is_saved
    editor.undo()
    assert not editor.is_saved
    editor.save()
    assert scene.read_text() == SCENE


def test_a_file_that_was_changed_on_disk_is_not_overwritten(editor: Editor, scene: Path) -> None:
    editor.set("shelf", "tx", "5")
    other = SCENE.replace("a room", "their room")
    scene.write_text(other)
    with pytest.raises(EditorError, match=r"scene\.xml was changed on disk after it was read: nothing is written"):
        editor.save()
    assert scene.read_text() == other
    assert editor.save_copy() == scene.with_name("scene-2.xml")
    assert editor.save_copy() == scene.with_name("scene-3.xml")
    assert 'tx="5"' in scene.with_name("scene-2.xml").read_text()
    editor.load()
    assert editor.is_saved
    editor.set("shelf", "tx", "6")
    editor.save()
    assert scene.read_text() == other.replace("1000.123456", "6")


def test_a_file_that_is_broken_meanwhile_is_not_loaded(editor: Editor, scene: Path) -> None:
    editor.set("shelf", "tx", "5")
    scene.write_text("<innerModel>")
    with pytest.raises(InnerModelError):
        editor.load()
    assert editor.tree.node("shelf").values["tx"] == 5


def test_a_file_that_cannot_be_written_is_told(scene: Path) -> None:
    def write(path: Path, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    editor = Editor(scene, write)
    editor.set("shelf", "tx", "5")
    with pytest.raises(EditorError, match=r"scene\.xml cannot be written: No space left on device"):
        editor.save()
    assert not editor.is_saved


def test_an_edit_of_an_included_file_is_saved_there(scene: Path) -> None:
    main = scene.with_name("main.xml")
    main.write_text('<innerModel><include path="scene.xml"/></innerModel>')
    editor = Editor(main, replace_file)
    editor.set("shelf", "tx", "5")
    with pytest.raises(EditorError, match=r"scene\.xml is an included file"):
        editor.save_copy()
    assert editor.save() == [scene]
    assert main.read_text() == '<innerModel><include path="scene.xml"/></innerModel>'
    assert scene.read_text() == SCENE.replace("1000.123456", "5")
