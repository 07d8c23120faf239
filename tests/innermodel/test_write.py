"""Only what was changed differs in the files of a tree."""

from __future__ import annotations

import difflib
import re
from pathlib import Path

import numpy as np
import pytest

from robocomp_py.innermodel.read import InnerModelError, read
from robocomp_py.innermodel.tree import Tree

HOUSE = """\
<?xml version="1.0"?>
<InnerModel>   <!-- a comment -->
\t<Transform  id='world'   tx="1.50">
\t\t<plane id="floor" ny="1"
\t\t       size="-4000, 4000,10" texture="a&amp;b.png"/>
\t\t<translation id="table" tx="100"><joint id="arm" /></translation>
\t\t<include path="cup.xml"/>
\t</Transform>
</InnerModel>
"""
CUP = '<innerModel>\n  <transform id="cup">\n    <imu id="imu"/>\n  </transform>\n</innerModel>\n'


@pytest.fixture
def house(tmp_path: Path) -> Path:
    (tmp_path / "cup.xml").write_text(CUP)
    path = tmp_path / "house.xml"
    path.write_text(HOUSE)
    return path


def changed_lines(after: str) -> list[str]:
    compared = difflib.ndiff(HOUSE.splitlines(), after.splitlines())
    return [line for line in compared if line[:1] in "+-"]


def text_of(tree: Tree, path: Path) -> str:
    return tree.texts()[path].decode()


def test_a_tree_that_was_not_changed_has_nothing_to_write(house: Path) -> None:
    assert Tree.read(house).texts() == {}


def test_saving_twice_gives_the_same_bytes(house: Path) -> None:
    tree = Tree.read(house)
    tree.update_translation("table", (1, 2, 3))
    tree.save()
    first = house.read_bytes()
    again = Tree.read(house)
    again.save(house)
    assert house.read_bytes() == first


def test_an_attribute_changes_alone(house: Path) -> None:
    tree = Tree.read(house)
    tree.set_value("world", "tx", 2.25)
    assert changed_lines(text_of(tree, house)) == [
        "- \t<Transform  id='world'   tx=\"1.50\">",
        "+ \t<Transform  id='world'   tx=\"2.25\">",
    ]


def test_an_attribute_that_is_set_back_leaves_the_file_as_it_was(house: Path) -> None:
    tree = Tree.read(house)
    tree.update_translation("table", (1, 2, 3))
    tree.update_translation("table", (100, 0, 0))
    assert tree.texts() == {}


def test_an_attribute_that_was_not_written_is_added(house: Path) -> None:
    tree = Tree.read(house)
    tree.set_value("arm", "ry", 0.5)
    assert '<joint id="arm" ry="0.5" />' in text_of(tree, house)


def test_a_thousand_edits_change_only_their_attributes(house: Path) -> None:
    random = np.random.default_rng(7)
    for _ in range(1000):
        tree = Tree.read(house)
        name, attribute = [("world", "tx"), ("table", "tx"), ("floor", "ny")][random.integers(3)]
        value = float(np.round(random.uniform(-5000, 5000), 3))
        tree.set_value(name, attribute, value)
        removed, added = changed_lines(text_of(tree, house))
        told = re.compile(rf"(?<= {attribute}=)(?P<quote>['\"]).*?(?P=quote)")
        assert told.sub("", removed[2:]) == told.sub("", added[2:]) != added[2:]
        house_again = house.with_name("again.xml")
        tree.save(house_again)
        assert Tree.read(house_again).node(name).values[attribute] == value


def test_texts_are_escaped(house: Path) -> None:
    tree = Tree.read(house)
    tree.set_value("floor", "texture", """<'"&>""")
    tree.save()
    assert Tree.read(house).node("floor").values["texture"] == """<'"&>"""


def test_nodes_are_added_with_indentation(house: Path) -> None:
    tree = Tree.read(house)
    tree.add("arm", "transform", "hand", tx=5.0)
    tree.add("hand", "imu", "feel", port=10)
    tree.save()
    text = house.read_text()
    assert '<joint id="arm">' in text
    assert '<imu id="feel" port="10"/>' in text
    assert [each.id for each in read(house).elements[0].children] == ["floor", "table", "cup"]
    assert Tree.read(house).node("hand").children == ("feel",)


def test_removed_nodes_are_cut_out(house: Path) -> None:
    tree = Tree.read(house)
    tree.remove("floor")
    assert changed_lines(text_of(tree, house)) == [
        '- \t\t<plane id="floor" ny="1"',
        '- \t\t       size="-4000, 4000,10" texture="a&amp;b.png"/>',
    ]


def test_a_moved_node_takes_its_text_along(house: Path) -> None:
    tree = Tree.read(house)
    tree.add("world", "transform", "new")
    tree.move("floor", "new")
    tree.move("arm", "new")
    tree.save()
    again = Tree.read(house)
    assert again.node("new").children == ("floor", "arm")
    assert again.node("floor").values == tree.node("floor").values
    assert 'texture="a&amp;b.png"' in house.read_text()


def test_a_change_of_an_included_file_goes_to_that_file(house: Path) -> None:
    tree = Tree.read(house)
    tree.set_value("cup", "ty", 20.0)
    assert list(tree.texts()) == [house.with_name("cup.xml")]
    with pytest.raises(InnerModelError, match=r"cup\.xml is an included file"):
        tree.save(house.with_name("other.xml"))
    tree.save()
    assert house.read_text() == HOUSE
    assert 'id="cup" ty="20"' in house.with_name("cup.xml").read_text()


def test_a_new_tree_is_written_whole(tmp_path: Path) -> None:
    tree = Tree()
    tree.add("root", "transform", "world", ry=0.5)
    tree.add("world", "plane", "floor", ny=1.0, size=(4000.0, 4000.0, 10.0))
    with pytest.raises(InnerModelError, match="not read from a file"):
        tree.save()
    tree.save(tmp_path / "new.xml")
    again = Tree.read(tmp_path / "new.xml")
    assert again.ids == tree.ids
    assert again.node("floor").values == tree.node("floor").values


def test_a_file_in_latin_1_stays_so(tmp_path: Path) -> None:
    path = tmp_path / "house.xml"
    text = "<?xml version='1.0' encoding='ISO-8859-1'?>\n<innerModel><imu id='é'/></innerModel>"
    path.write_bytes(text.encode("latin-1"))
    tree = Tree.read(path)
    tree.add("root", "plane", "sol", texture="à €")
    tree.save()
    again = Tree.read(path)
    assert again.ids == ["root", "é", "sol"]
    assert again.node("sol").values["texture"] == "à €"


def test_a_tree_is_one_text_with_absolute_paths(tmp_path: Path) -> None:
    (tmp_path / "more.xml").write_text('<innerModel><mesh id="cup" file="cup.obj" scale="2"/></innerModel>')
    (tmp_path / "cup.obj").write_text("")
    main = tmp_path / "main.xml"
    main.write_text('<innerModel><!-- a --><transform id="t"><include path="more.xml"/></transform></innerModel>')
    tree = Tree.read(main)
    tree.add("t", "plane", "board", texture="nowhere.png")
    assert (
        tree.text().decode()
        == f"""\
<innerModel>
    <transform id="t">
        <mesh id="cup" file="{tmp_path}/cup.obj" scale="2"/>
        <plane id="board" texture="nowhere.png"/>
    </transform>
</innerModel>
"""
    )
    assert tree.texts() != {}
    assert tree.node("cup").values["file"] == "cup.obj"
