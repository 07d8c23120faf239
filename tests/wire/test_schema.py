"""Other programs read our messages by the schemas that a recording has."""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given, settings

from robocomp_py.contract import told
from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import FLOAT32, INT32, TIME, Enumeration, Field, Sequence, Struct
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.schema import omgidl, ros2msg

from .messages import messages, patiently
from .schemas import by_mcap_ros2, by_rosbags, expected, operation_of

TDATA = Struct("RoboCompLaser::TData", (Field("maxAngle", FLOAT32), Field("dist", FLOAT32)))
LASER = Operation[Any](
    "RoboCompLaserPub::LaserPub",
    "pushLaserData",
    (
        Field("laserData", Sequence(TDATA)),
        Field("at", TIME),
        Field("mode", Enumeration("RoboCompLaser::Mode", (("near", 0), ("far", 4)))),
    ),
)


@given(messages())
@settings(patiently, max_examples=25)
def test_rosbags_and_the_reader_of_mcap_decode_any_message(sent: tuple[Struct, tuple[Any, ...]]) -> None:
    message, values = sent
    operation = told.operation(operation_of(message).text)
    schema = ros2msg(operation)
    payload = bytes(Cdr().encoder(message)(values))
    wanted = repr(expected(message.fields, values))
    assert repr(by_rosbags(schema, payload)) == wanted
    assert repr(by_mcap_ros2(schema, payload)) == wanted


def test_names_are_those_of_the_packages_for_ros() -> None:
    schema = ros2msg(LASER)
    assert schema.name == "robocomp_laser_pub/msg/LaserPubPushLaserData"
    assert schema.text.splitlines() == [
        "robocomp_laser/TData[] laser_data",
        "builtin_interfaces/Time at",
        "int32 mode  # near = 0, far = 4",
        "=" * 80,
        "MSG: builtin_interfaces/Time",
        "int32 sec",
        "uint32 nanosec",
        "=" * 80,
        "MSG: robocomp_laser/TData",
        "float32 max_angle",
        "float32 dist",
    ]


def test_idl_keeps_the_names_of_the_contract_and_has_no_preprocessor() -> None:
    schema = omgidl(LASER)
    assert schema.name == "RoboCompLaserPub::LaserPubPushLaserData"
    assert "module RoboCompLaser { struct TData {\n    float maxAngle;\n    float dist;\n}; };" in schema.text
    assert "sequence<RoboCompLaser::TData> laserData;" in schema.text
    assert "#" not in schema.text


@pytest.mark.parametrize(
    ("given", "found"),
    [
        (("maxSpeed", "max_speed"), ["max_speed", "max_speed2"]),
        (("x", "X"), ["x", "x2"]),
        (("class", "_2d"), ["class_value", "f_2d"]),
    ],
)
def test_fields_that_ros_would_name_alike_get_numbers(given: tuple[str, ...], found: list[str]) -> None:
    schema = ros2msg(Operation("A::B", "c", tuple(Field(each, INT32) for each in given)))
    assert re.findall(r"int32 (\w+)", schema.text) == found


def test_two_structs_of_one_name_stay_two() -> None:
    one, other = (Struct("A::S", (Field(name, INT32),)) for name in "xy")
    schema = ros2msg(Operation("A::B", "c", (Field("one", one), Field("other", other))))
    assert re.findall("a/S[0-9]* ", schema.text) == ["a/S ", "a/S2 "]


def test_a_struct_that_is_named_as_the_message_stays_apart() -> None:
    schema = ros2msg(Operation("A::B", "c", (Field("one", Struct("A::BC", (Field("x", INT32),))),)))
    assert (schema.name, schema.text.splitlines()[0]) == ("a/msg/BC", "a/BC2 one")
