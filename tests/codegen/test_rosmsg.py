"""IDSL as messages and services of ROS 2, and what rosbags, which reads them, finds in them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from robocomp_py.contract.rosnames import package_of, snake

from .exported import SHIPPED_FILES, exported, in_format
from .generated import MODELS


def types_in(texts: dict[str, str]) -> dict[str, dict[str, Any]]:
    """Fields and constants by type, read by rosbags, which knows all types that they use, too."""
    types = {}
    for path, text in texts.items():
        package, name = path.split("/")[0], Path(path).stem
        if path.endswith(".msg"):
            types.update(get_types_from_msg(text, f"{package}/msg/{name}"))
        elif path.endswith(".srv"):
            asked, answered = re.split("^---\n", text, flags=re.MULTILINE)
            types.update(get_types_from_msg(asked, f"{package}/msg/{name}_Request"))
            types.update(get_types_from_msg(answered, f"{package}/msg/{name}_Response"))
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(types)
    for name in types:
        store.generate_msgdef(name, ros_version=2)
    return {
        name: {"constants": constants, "fields": [field for field, _ in fields]}
        for name, (constants, fields) in types.items()
    }


@pytest.mark.parametrize("path", [*SHIPPED_FILES, MODELS / "Everything.idsl"], ids=lambda path: path.stem)
def test_rosbags_reads_every_message_and_service(path: Path) -> None:
    texts, report = exported(path, "rosmsg")
    assert report.errors == []
    types = types_in(texts)
    assert len(types) >= len([name for name in texts if name.endswith((".msg", ".srv"))])


def test_a_module_becomes_a_package() -> None:
    assert package_of("RoboCompLaser") == "robocomp_laser"
    assert package_of("RoboCompJointMotorSimple") == "robocomp_joint_motor_simple"
    assert package_of("RoboCompRGBDBus") == "robocomp_rgbd_bus"
    assert package_of("Arm_2") == "arm_2"


def test_names_of_fields_are_written_with_underscores() -> None:
    assert [snake(each) for each in ("maxSpeed", "RGBImage", "x", "_hidden", "two__parts", "Angle2D")] == [
        *("max_speed", "rgb_image", "x", "hidden", "two_parts", "angle2_d")
    ]


def test_queries_are_services_and_what_goes_one_way_is_a_message(tmp_path: Path) -> None:
    idsl = """module X { interface I {
        [query] int ask(int a, out int b); [command] void go(int c); [publish] void said(int d); void either(int e); };
    };"""
    texts, _ = in_format(tmp_path, idsl, "rosmsg")
    found = {path.removeprefix("x/") for path in texts if path.endswith((".msg", ".srv"))}
    assert found == {"srv/IAsk.srv", "msg/IGo.msg", "msg/ISaid.msg", "srv/IEither.srv", "msg/IEither.msg"}
    types = types_in(texts)
    assert types["x/msg/IAsk_Request"]["fields"] == ["a"]
    assert types["x/msg/IAsk_Response"]["fields"] == ["ret", "b"]


def test_inherited_operations_are_services_of_the_interface_that_has_them(tmp_path: Path) -> None:
    idsl = "module X { interface A { int f(); }; interface B extends A { int g(); }; };"
    texts, _ = in_format(tmp_path, idsl, "rosmsg")
    assert {path for path in texts if path.endswith(".srv")} == {"x/srv/AF.srv", "x/srv/BF.srv", "x/srv/BG.srv"}


def test_enumerators_and_constants_are_constants(tmp_path: Path) -> None:
    idsl = 'module X { enum Mode { slow = -1, veryFast }; const Mode usual = veryFast; const string name = "a b"; };'
    texts, _ = in_format(tmp_path, idsl, "rosmsg")
    types = types_in(texts)
    assert types["x/msg/Mode"]["constants"] == [("SLOW", "int32", -1), ("VERY_FAST", "int32", 0)]
    assert types["x/msg/Constants"]["constants"] == [("USUAL", "int32", 0), ("NAME", "string", "a b")]


def test_defaults_are_kept(tmp_path: Path) -> None:
    fields = 'E e = b; bool f = true; float g = 1.5f; string h = "x"; byte i = 0x10;'
    idsl = f"module X {{ enum E {{ a, b }}; struct S {{ {fields} }}; }};"
    texts, _ = in_format(tmp_path, idsl, "rosmsg")
    lines = texts["x/msg/S.msg"].splitlines()[1:]
    assert lines == ["int32 e 1  # E", "bool f true", "float32 g 1.5", 'string h "x"', "uint8 i 16"]


def test_dictionaries_and_sequences_of_sequences_become_messages(tmp_path: Path) -> None:
    idsl = """module X { sequence<int> Row; dictionary<string, Row> Named;
        struct S {
            sequence<Row> table; sequence<sequence<sequence<float>>> cube; Named named; sequence<Named> many;
        }; };"""
    texts, _ = in_format(tmp_path, idsl, "rosmsg")
    bodies = {path.removeprefix("x/msg/"): text.splitlines()[1:] for path, text in texts.items() if "/msg/" in path}
    assert bodies == {
        "S.msg": ["Row[] table", "Float32SequenceSequence[] cube", "NamedEntry[] named", "Named[] many"],
        "Row.msg": ["int32[] items"],
        "Float32SequenceSequence.msg": ["Float32Sequence[] items"],
        "Float32Sequence.msg": ["float32[] items"],
        "NamedEntry.msg": ["string key", "int32[] value"],
        "Named.msg": ["NamedEntry[] items"],
    }
    types_in(texts)


def test_an_exception_has_the_fields_of_those_it_extends(tmp_path: Path) -> None:
    idsl = "module X { exception A { int a; }; exception B extends A { int b; }; };"
    texts, _ = in_format(tmp_path, idsl, "rosmsg")
    assert types_in(texts)["x/msg/B"]["fields"] == ["a", "b"]


def test_a_package_can_be_built(tmp_path: Path) -> None:
    """It lists its files, and the packages whose types it uses."""
    (tmp_path / "Y.idsl").write_text("module RoboCompY { struct Point { float x; }; };")
    idsl = 'import "Y.idsl"; module RoboCompX { struct S { RoboCompY::Point p; time t; }; interface I { int f(); }; };'
    texts, _ = in_format(tmp_path, idsl, "rosmsg")
    cmake = texts["robocomp_x/CMakeLists.txt"]
    assert set(re.findall(r'^  "(.*)"$', cmake, re.MULTILINE)) == {"msg/S.msg", "srv/IF.srv"}
    assert "DEPENDENCIES builtin_interfaces robocomp_y\n" in cmake
    package = ElementTree.fromstring(texts["robocomp_x/package.xml"])
    assert package.findtext("name") == "robocomp_x"
    assert [each.text for each in package.findall("depend")] == ["builtin_interfaces", "robocomp_y"]


def test_modules_that_would_be_one_package_are_refused(tmp_path: Path) -> None:
    (tmp_path / "Y.idsl").write_text("module Robocomp_X { struct Point { float x; }; };")
    _, codes = in_format(tmp_path, 'import "Y.idsl"; module RoboCompX { struct S { float x; }; };', "rosmsg")
    assert codes == ["not-in-rosmsg"]


def test_actions_are_actions(tmp_path: Path) -> None:
    idsl = """module X { struct Place { float x; }; exception Blocked { string by; }; interface I {
        [action] int goTo(Place target) feedback(float left) throws Blocked; [action] void dock(); }; };"""
    texts, codes = in_format(tmp_path, idsl, "rosmsg")
    assert texts["x/action/IGoTo.action"].endswith("\nPlace target\n---\nint32 ret\n---\nfloat32 left\n")
    assert texts["x/action/IDock.action"].endswith("\n---\n---\n")
    assert "<depend>action_msgs</depend>" in texts["x/package.xml"]
    assert codes == ["lossy-in-rosmsg"]
    assert "x/msg/IGoToFeedback.msg" not in texts


def test_the_parts_of_actions_are_in_omg_idl(tmp_path: Path) -> None:
    idsl = "module X { interface I { [action] int goTo(float x) feedback(float left); void stop(); }; };"
    texts, codes = in_format(tmp_path, idsl, "omgidl")
    assert "struct IGoToStartRequest" in texts["X.idl"]
    assert codes == []
