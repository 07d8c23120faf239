"""InnerModel files: what is read, with its place, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from robocomp_py.innermodel.nodes import TAGS
from robocomp_py.innermodel.read import MOST_BYTES, Model, every, read


def written(folder: Path, text: str | bytes, name: str = "house.xml") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def model(folder: Path, inner: str) -> Model:
    return read(written(folder, f"<innerModel>\n{inner}\n</innerModel>"))


def test_every_tag_is_read_without_its_optional_attributes(tmp_path: Path) -> None:
    tags = [name for name in TAGS if name not in ("innermodel", "include", "laser")]
    found = model(tmp_path, "".join(f'<{name} id="{name}"/>' for name in tags))
    assert found.problems == ()
    assert [each.tag.name for each in found.elements] == tags


def test_an_unknown_attribute_is_told_where_its_name_stands(tmp_path: Path) -> None:
    (problem,) = model(tmp_path, '<translation id="tz" tz = "1" ty2="ty2"/>').problems
    assert (problem.code, problem.place.line, problem.place.column) == ("unknown-attribute", 2, 31)
    assert (tmp_path / "house.xml").read_bytes()[problem.place.start : problem.place.end] == b"ty2"


def test_a_laser_with_a_misspelt_attribute_is_told_that_alone(tmp_path: Path) -> None:
    (problem,) = model(tmp_path, '<laser id="a" mesures="9" max="9"/>').problems
    assert (problem.code, problem.hint) == ("unknown-attribute", "did you mean `measures`?")


def test_every_attribute_of_every_tag_is_read(tmp_path: Path) -> None:
    for tag in TAGS.values():
        texts = " ".join(
            f'{each.name}="{each.default if each.kind.value.startswith("`") else 1}"'
            for each in tag.attributes.values()
        )
        if tag.name not in ("innermodel", "include"):
            assert model(tmp_path, f"<{tag.name} {texts}/>").problems == ()


def test_the_case_of_tags_does_not_matter(tmp_path: Path) -> None:
    found = model(tmp_path, '<Transform id="a"><JOINT id="b"/></Transform>')
    assert [each.id for each in every(found.elements)] == ["a", "b"]


def test_missing_values_have_defaults(tmp_path: Path) -> None:
    (joint,) = model(tmp_path, '<joint id="elbow" rx="0.5"/>').elements
    assert joint.values["axis"] == "z"
    assert (joint.values["min"], joint.values["max"]) == (-math.inf, math.inf)
    assert joint.written == {"id": "elbow", "rx": 0.5}


@pytest.mark.parametrize(
    ("tag", "written", "hint"),
    [
        ("plane", 'size="300 200 400"', "did you mean `300,200,400`?"),
        ("plane", 'size="300; 200"', "did you mean `300,200`?"),
        ("plane", 'size="300,2OO,4 cm"', "did you mean `300,200,40`?"),
        ("plane", 'size="0,5 0,3"', "write numbers with commas between them"),
        ("plane", 'collide="Yes"', "did you mean `1`?"),
        ("plane", 'collide="off"', "did you mean `0`?"),
        ("plane", 'collide="maybe"', "write 0 or 1"),
        ("plane", 'collide="2"', "write 0 or 1"),
        ("transform", 'ty="20O"', "did you mean `200`?"),
        ("transform", 'ty="0,5"', "did you mean `0.5`?"),
        ("transform", 'ty="1_000"', "did you mean `1000`?"),
        ("transform", 'ty="1.5m"', "did you mean `1500`?"),
        ("transform", 'ty="90°"', "write a number"),
        ("transform", 'ry="-90 deg"', "did you mean `-1.570796`?"),
        ("transform", 'ry="\N{MINUS SIGN}0.5"', "did you mean `-0.5`?"),
        ("transform", 'mass="250g"', "did you mean `0.25`?"),
        ("transform", 'mass="o"', "write a number"),
        ("transform", 'mass=""', "write a number"),
        ("imu", 'port="1OO00"', "did you mean `10000`?"),
    ],
)
def test_a_text_that_counts_as_0_has_a_remedy(tmp_path: Path, tag: str, written: str, hint: str) -> None:
    (problem,) = model(tmp_path, f'<{tag} id="a" {written}/>').problems
    assert (problem.code, problem.hint, problem.is_error) == ("read-otherwise", hint, False)


@pytest.mark.parametrize(
    ("tag", "written", "told"),
    [
        ("laser", 'measures="9" angle="3" max="inf"', "`max` is `inf`, which is no finite number"),
        (
            "laser",
            'measures="200000" angle="3" max="9"',
            "`measures` is a whole number of at most 100000, not `200000`",
        ),
        ("rgbd", 'width="20000"', "`width` is a whole number of at most 16384, not `20000`"),
        ("imu", 'port="99999"', "`port` is a whole number of at most 65535, not `99999`"),
        ("joint", 'min="nan"', "`min` is `nan`, which is no finite number"),
    ],
)
def test_a_number_that_nothing_can_have_is_an_error(tmp_path: Path, tag: str, written: str, told: str) -> None:
    (problem,) = model(tmp_path, f'<{tag} id="a" {written}/>').errors
    assert (problem.code, problem.message) == ("wrong-value", told)
    assert not model(tmp_path, '<joint id="a" min="-inf" max="inf"/>').problems


def test_values_that_cannot_be_meant_are_read_as_robocomp_reads_them(tmp_path: Path) -> None:
    text = '<joint id="a" min="2" max="1"/><plane id="b" texture="#12" size="0,0,0"/><mesh id="c"/>'
    laser = '<laser id="d/e" measures="9" min="5" max="4" angle="180"/>'
    assert model(tmp_path, text + laser).problems == ()


def test_nodes_of_included_files_stand_where_they_are_included(tmp_path: Path) -> None:
    written(tmp_path, '<innerModel><mesh id="cup" file="cup.obj"/></innerModel>', "cup.xml")
    found = model(tmp_path, '<transform id="table"><include path="cup.xml"/><imu id="imu"/></transform>')
    assert [each.id for each in found.elements[0].children] == ["cup", "imu"]
    assert [each.path.name for each in found.documents] == ["house.xml", "cup.xml"]


def test_an_absolute_path_of_another_machine_is_mapped(tmp_path: Path) -> None:
    (tmp_path / "files").mkdir()
    written(tmp_path / "files", '<innerModel><imu id="imu"/></innerModel>', "robot.xml")
    house = written(tmp_path, '<innerModel><include path="/home/robot/files/robot.xml"/></innerModel>')
    found = read(house, prefixes={"/home/robot": tmp_path})
    assert [each.id for each in found.elements] == ["imu"]
    assert [each.code for each in read(house).problems] == ["missing-include"]


def test_an_id_of_an_included_file_is_not_used_again(tmp_path: Path) -> None:
    written(tmp_path, '<innerModel>\n<imu id="imu"/></innerModel>', "robot.xml")
    (problem,) = model(tmp_path, '<imu id="imu"/>\n<include path="robot.xml"/>').errors
    assert (problem.code, problem.place.path.name, problem.place.line) == ("repeated-id", "robot.xml", 2)
    assert [place.path.name for _, place in problem.related] == ["house.xml"]


def test_children_of_an_unknown_tag_are_checked_too(tmp_path: Path) -> None:
    codes = [each.code for each in model(tmp_path, '<body id="a"><jont id="b"/><imu/></body>').errors]
    assert codes == ["unknown-tag", "unknown-tag", "missing-id"]


def test_a_place_is_that_of_the_value_in_characters(tmp_path: Path) -> None:
    (problem,) = model(tmp_path, '  <!-- tête --> <joint id="é" axis="w"/>').errors
    assert str(problem.place) == f"{tmp_path}/house.xml:2:37"


@pytest.mark.parametrize(
    ("data", "code", "message"),
    [
        (b"", "syntax", "no element found"),
        (b"<innerModel>", "syntax", "no element found"),
        (b"<innerModel><joint id='a'></innerModel>", "syntax", "mismatched tag"),
        ("<innerModel/>".encode("utf-16"), "not-utf8", "UTF-16"),
        (b"<innerModel>\xe9</innerModel>", "syntax", "not well-formed"),
        (b"<!DOCTYPE a [<!ENTITY b 'c'>]><innerModel/>", "syntax", "DOCTYPE"),
        (b"<innerModel><imu id='a' id='b'/></innerModel>", "syntax", "duplicate attribute"),
        (b"<innerModel><imu id='a\x01'/></innerModel>", "syntax", "not well-formed"),
        (b"<innerModel><imu id='&#9;'/></innerModel>", "missing-id", "has no `id`"),
        (b"<innerModel>" + b" " * MOST_BYTES + b"</innerModel>", "too-large", "4 MB"),
        (b"<innerModel>" + b"<transform id='a'>" * 300 + b"</innerModel>", "too-deep", "200 deep"),
    ],
)
def test_a_wrong_file_is_refused_with_its_reason(tmp_path: Path, data: bytes, code: str, message: str) -> None:
    problems = read(written(tmp_path, data)).errors
    assert [each.code for each in problems] == [code]
    assert message in problems[0].message


def test_a_file_that_is_not_there_is_a_problem_not_an_error_of_python(tmp_path: Path) -> None:
    assert [each.code for each in read(tmp_path / "absent.xml").problems] == ["unreadable"]
    assert [each.code for each in read(tmp_path).problems] == ["unreadable"]


def test_two_files_that_include_each_other_are_refused(tmp_path: Path) -> None:
    written(tmp_path, '<innerModel><include path="house.xml"/></innerModel>', "other.xml")
    (problem,) = model(tmp_path, '<include path="other.xml"/>').errors
    assert (problem.code, problem.place.path.name) == ("cyclic-include", "other.xml")


def test_a_long_chain_of_includes_is_refused(tmp_path: Path) -> None:
    for number in range(40):
        written(tmp_path, f'<innerModel><include path="{number + 1}.xml"/></innerModel>', f"{number}.xml")
    assert [each.code for each in read(tmp_path / "0.xml").problems] == ["too-deep"]
