"""XCDR1 byte by byte, and against two other implementations of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT8,
    INT16,
    INT32,
    INT64,
    STRING,
    TIME,
    UINT8,
    UINT16,
    UINT32,
    Dictionary,
    Field,
    Sequence,
    Struct,
    Type,
)
from robocomp_py.errors import DecodeError, EncodeError
from robocomp_py.testing import everything as e
from robocomp_py.testing.conformance import assert_same, everything_odd
from robocomp_py.testing.everything import Colour, Nothing, Point
from robocomp_py.wire.cdr import TAIL, Cdr
from robocomp_py.wire.codec import MAX_BYTES

from .codecs import RICH, one, rich
from .messages import messages, patiently
from .second_opinions import by_pycdr2, by_ros2, by_rosbags

CODEC = Cdr()


def encoded(message: Struct, *values: Any) -> bytes:
    payload: bytes = CODEC.encoder(message)(values)
    return payload


def struct(*kinds: Type) -> Struct:
    return Struct("Test::Message", tuple(Field(f"f{number}", kind) for number, kind in enumerate(kinds)))


BYTES: list[tuple[Struct, tuple[Any, ...], str]] = [
    (struct(), (), "00"),
    (struct(BOOL, INT8, UINT8), (True, -1, 255), "01 ff ff"),
    (struct(UINT8, UINT16, UINT8, UINT32), (1, 2, 3, 4), "01 00 0200 03 000000 04000000"),
    (struct(UINT8, INT64), (1, -2), "01 00000000000000 feffffffffffffff"),
    (struct(UINT32, FLOAT64), (1, 0.5), "01000000 00000000 000000000000e03f"),
    (struct(FLOAT32, UINT8), (0.1, 1), "cdcccc3d 01"),
    (struct(STRING), ("é",), "03000000 c3a9 00"),
    (struct(STRING, UINT16), ("", 1), "01000000 00 00 0100"),
    (struct(TIME), (1_500_000_000,), "01000000 0065cd1d"),
    (struct(UINT8, TIME), (1, -1), "01 000000 ffffffff ffc99a3b"),
    (struct(Colour.__contract__), (Colour.ultraviolet,), "f9ffffff"),
    (struct(UINT8, Nothing.__contract__, UINT8), (1, Nothing(), 2), "01 00 02"),
    (struct(Sequence(UINT8), UINT16), (b"abc", 1), "03000000 616263 00 0100"),
    (struct(Sequence(BOOL)), ([True, False],), "02000000 01 00"),
    (struct(Sequence(FLOAT64)), ([0.5],), "01000000 00000000 000000000000e03f"),
    (struct(Sequence(FLOAT64), UINT32), ([], 1), "00000000 01000000"),
    (struct(Sequence(Point.__contract__), UINT32), ([], 1), "00000000 01000000"),
    (struct(Sequence(STRING)), (["a", ""],), "02000000 02000000 6100 0000 01000000 00"),
    (struct(Sequence(Sequence(UINT8))), ([b"a", b""],), "02000000 01000000 61 000000 00000000"),
    (struct(Sequence(Nothing.__contract__)), ([Nothing()] * 3,), "03000000 000000"),
    (struct(Dictionary(INT8, INT16)), ({1: 2, 3: 4},), "02000000 01 00 0200 03 00 0400"),
]


@pytest.mark.parametrize(("message", "values", "expected"), BYTES)
def test_the_layout_is_that_of_the_standard(message: Struct, values: tuple[Any, ...], expected: str) -> None:
    payload = encoded(message, *values)
    assert payload.hex() == bytes.fromhex("00 01 00 00" + expected).hex()
    assert by_pycdr2(message, CODEC.decoder(message)(payload)) == payload
    assert by_rosbags(message, CODEC.decoder(message)(payload)) == payload


# Between the count of an empty sequence and what follows nothing is written, not even the padding
# that its items would have needed: so do Fast CDR (which returns early for no items), Cyclone DDS
# and both second opinions. Nothing is written behind the last field either; DDS may pad a payload
# when it sends it, which is why the decoder lets up to three octets pass.


@patiently
@given(messages())
def test_pycdr2_writes_the_same_bytes(sent: tuple[Struct, tuple[Any, ...]]) -> None:
    message, values = sent
    assert by_pycdr2(message, values).hex() == encoded(message, *values).hex()


@patiently
@given(messages())
def test_rosbags_writes_the_same_bytes(sent: tuple[Struct, tuple[Any, ...]]) -> None:
    message, values = sent
    assert by_rosbags(message, values).hex() == encoded(message, *values).hex()


HEADER = Struct("std_msgs::Header", (Field("stamp", TIME), Field("frame_id", STRING)))
SCAN = Struct(
    "sensor_msgs::LaserScan",
    (
        Field("header", HEADER),
        *(Field(name, FLOAT32) for name in ("angle_min", "angle_max", "angle_increment", "time_increment")),
        *(Field(name, FLOAT32) for name in ("scan_time", "range_min", "range_max")),
        Field("ranges", Sequence(FLOAT32)),
        Field("intensities", Sequence(FLOAT32)),
    ),
)
IMAGE = Struct(
    "sensor_msgs::Image",
    (
        Field("header", HEADER),
        Field("height", UINT32),
        Field("width", UINT32),
        Field("encoding", STRING),
        Field("is_bigendian", UINT8),
        Field("step", UINT32),
        Field("data", Sequence(UINT8)),
    ),
)
POINT_FIELD = Struct(
    "sensor_msgs::PointField",
    (Field("name", STRING), Field("offset", UINT32), Field("datatype", UINT8), Field("count", UINT32)),
)
CLOUD = Struct(
    "sensor_msgs::PointCloud2",
    (
        *(Field("header", HEADER), Field("height", UINT32), Field("width", UINT32)),
        Field("fields", Sequence(POINT_FIELD)),
        *(Field("is_bigendian", BOOL), Field("point_step", UINT32), Field("row_step", UINT32)),
        *(Field("data", Sequence(UINT8)), Field("is_dense", BOOL)),
    ),
)
JOINTS = Struct(
    "sensor_msgs::JointState",
    (
        *(Field("header", HEADER), Field("name", Sequence(STRING))),
        *(Field(name, Sequence(FLOAT64)) for name in ("position", "velocity", "effort")),
    ),
)
COMPRESSED = Struct(
    "sensor_msgs::CompressedImage",
    (Field("header", HEADER), Field("format", STRING), Field("data", Sequence(UINT8))),
)


def _numbers(name: str, *fields: str) -> Struct:
    return Struct(f"geometry_msgs::{name}", tuple(Field(each, FLOAT64) for each in fields))


def _matrix(size: int) -> Struct:
    """What ROS 2 has as an array of a fixed length: as many numbers, and no count."""
    return _numbers(f"Matrix{size}", *(f"m{place}" for place in range(size * size)))


VECTOR, TURN = _numbers("Vector3", "x", "y", "z"), _numbers("Quaternion", "x", "y", "z", "w")
IMU = Struct(
    "sensor_msgs::Imu",
    (
        *(Field("header", HEADER), Field("orientation", TURN), Field("orientation_covariance", _matrix(3))),
        *(Field("angular_velocity", VECTOR), Field("angular_velocity_covariance", _matrix(3))),
        *(Field("linear_acceleration", VECTOR), Field("linear_acceleration_covariance", _matrix(3))),
    ),
)
POSE = Struct("geometry_msgs::Pose", (Field("position", VECTOR), Field("orientation", TURN)))
TWIST = Struct("geometry_msgs::Twist", (Field("linear", VECTOR), Field("angular", VECTOR)))
ODOMETRY = Struct(
    "nav_msgs::Odometry",
    (
        *(Field("header", HEADER), Field("child_frame_id", STRING)),
        Field("pose", Struct("geometry_msgs::PoseC", (Field("pose", POSE), Field("covariance", _matrix(6))))),
        Field("twist", Struct("geometry_msgs::TwistC", (Field("twist", TWIST), Field("covariance", _matrix(6))))),
    ),
)
PATH = Struct(
    "nav_msgs::Path",
    (
        Field("header", HEADER),
        Field("poses", Sequence(Struct("geometry_msgs::PoseStamped", (Field("header", HEADER), Field("pose", POSE))))),
    ),
)
STAMP = (1_700_000_000_123_456_789, "base_laser")
THREE, FOUR, SIX = (0.1, -2.0, 1e300), (0.0, 0.0, 0.6, 0.8), ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
NINE, MANY = tuple(np.eye(3).flat), tuple(np.arange(36) / 7)
SENSORS: list[tuple[Struct, tuple[Any, ...]]] = [
    (SCAN, (STAMP, -1.5, 1.5, 0.5, 0.0, 0.1, 0.25, 30.0, np.linspace(0.3, 8.0, 361, dtype="f4"), np.zeros(0, "f4"))),
    (IMAGE, (STAMP, 4, 3, "rgb8", 0, 9, np.arange(36, dtype=np.uint8))),
    (IMAGE, (STAMP, 0, 0, "", 0, 0, np.zeros(0, np.uint8))),
    (
        CLOUD,
        (STAMP, 1, 2, [("x", 0, 7, 1), ("intensity", 4, 2, 1)], False, 5, 10, np.arange(10, dtype=np.uint8), True),
    ),
    (CLOUD, (STAMP, 0, 0, [], False, 0, 0, np.zeros(0, np.uint8), False)),
    (JOINTS, (STAMP, ["a", "elbow"], np.array([1.0, math.pi]), np.zeros(0), np.array([0.5]))),
    (JOINTS, (STAMP, [], np.zeros(0), np.zeros(0), np.zeros(0))),
    (COMPRESSED, (STAMP, "jpeg", np.arange(255, dtype=np.uint8))),
    (COMPRESSED, ((0, ""), "", np.zeros(0, np.uint8))),
    (IMU, (STAMP, FOUR, NINE, THREE, NINE, THREE, NINE)),
    (IMU, ((-1, "odd"), FOUR, NINE, THREE, NINE, THREE, NINE)),
    (ODOMETRY, (STAMP, "base", ((THREE, FOUR), MANY), (SIX, MANY))),
    (PATH, (STAMP, [(STAMP, (THREE, FOUR)), ((5, "x"), (THREE, FOUR))])),
]
MESSAGES = [*SENSORS, (RICH, rich())]


@pytest.mark.parametrize(("message", "values"), MESSAGES, ids=[message.name for message, _ in MESSAGES])
def test_sensor_messages_are_written_as_by_the_others(message: Struct, values: tuple[Any, ...]) -> None:
    payload = encoded(message, *values)
    assert payload == by_pycdr2(message, values)
    assert payload == by_rosbags(message, values)


@pytest.mark.parametrize(("message", "values"), SENSORS, ids=[message.name for message, _ in SENSORS])
def test_sensor_messages_are_written_as_by_ros_2(message: Struct, values: tuple[Any, ...]) -> None:
    assert encoded(message, *values) == by_ros2(message, values)


def test_received_arrays_are_views_of_the_payload() -> None:
    message = struct(STRING, *(Sequence(kind) for kind in (UINT8, INT16, FLOAT32, FLOAT64, BOOL)))
    payload = encoded(message, "x", b"abc", [1, 2], [0.5], [0.5, 1.0], [True])
    for array in CODEC.decoder(message)(payload)[1:]:
        assert np.shares_memory(array, np.frombuffer(payload, np.uint8))


def test_received_arrays_are_aligned_if_the_payload_is_placed_well() -> None:
    payload = encoded(struct(UINT8, Sequence(FLOAT64)), 1, [0.5])
    buffer = bytearray(4 + len(payload))
    memoryview(buffer)[4:] = payload
    assert np.frombuffer(buffer, np.uint8).ctypes.data % 8 == 0  # as Python's buffers are
    _, array = CODEC.decoder(struct(UINT8, Sequence(FLOAT64)))(memoryview(buffer)[4:])
    assert array.flags.aligned


def test_any_buffer_is_a_payload() -> None:
    payload = encoded(RICH, *rich())
    for buffer in (bytearray(payload), memoryview(payload), np.frombuffer(payload, np.uint8)):
        assert encoded(RICH, *CODEC.decoder(RICH)(buffer)) == payload


def test_the_encapsulation_counts_as_part_of_the_size() -> None:
    octets = np.zeros(MAX_BYTES - len("head") - len("size") + 1, np.uint8)
    with pytest.raises(EncodeError, match=f"{MAX_BYTES + 1} bytes"):
        encoded(one(Sequence(UINT8)), octets)


def test_padding_at_the_end_is_ignored() -> None:
    payload = encoded(one(UINT8), 7)
    for padding in (1, 2, 3):
        assert CODEC.decoder(one(UINT8))(payload + bytes(padding)) == (7,)
    with pytest.raises(DecodeError, match="4 bytes left over"):
        CODEC.decoder(one(UINT8))(payload + bytes(4))


def test_the_options_of_the_encapsulation_are_ignored() -> None:
    assert CODEC.decoder(one(UINT8))(b"\x00\x01\x00\x03\x07\x00\x00\x00") == (7,)


@pytest.mark.parametrize(
    "head", ["00 00 00 00", "00 02 00 00", "00 03 00 00", "00 06 00 00", "00 07 00 00", "01 01 00 00"]
)
def test_other_encapsulations_are_refused(head: str) -> None:
    with pytest.raises(DecodeError, match="not XCDR1 little-endian"):
        CODEC.decoder(one(UINT8))(bytes.fromhex(head) + b"\x07")


def test_an_empty_string_may_come_without_its_nul() -> None:
    assert CODEC.decoder(struct(STRING, UINT32))(bytes.fromhex("00010000 00000000 05000000")) == ("", 5)


WRONG: list[tuple[Type, str, str]] = [
    (BOOL, "02", "IndexError"),
    (Sequence(BOOL), "02000000 00 02", "a bool is neither 0 nor 1"),
    (STRING, "02000000 6161", "without its end"),
    (STRING, "02000000 ff00", "UnicodeDecodeError"),
    (STRING, "09000000 6100", "a string of 9 bytes in 2"),
    (Colour.__contract__, "02000000", "KeyError: 2"),
    (TIME, "00000000 00ca9a3b", "1000000000 nanoseconds are more than a second"),
    (Sequence(FLOAT64), "02000000 00000000 0000000000000000", "buffer is smaller"),
    (Sequence(Point.__contract__), "05000000 00000000", "5 items in 4 bytes"),
    (Sequence(STRING), "05000000 00000000", "5 items in 4 bytes"),
    (Dictionary(INT32, INT32), "05000000 00000000", "5 items in 4 bytes"),
    (Dictionary(STRING, INT64), "01000000 01000000", "a string of 1 bytes in 0"),
]


@pytest.mark.parametrize(("kind", "body", "reason"), WRONG)
def test_a_value_that_does_not_fit_is_refused(kind: Type, body: str, reason: str) -> None:
    with pytest.raises(DecodeError, match=reason):
        CODEC.decoder(one(kind))(bytes.fromhex("00010000" + body))


@pytest.mark.parametrize("value", [e.Nested(), everything_odd()])
def test_with_room_for_a_header_the_fields_are_the_same_bytes(value: e.Nested) -> None:
    message, roomy = e.echo_nested.request, Cdr(room=40)
    plain, payload = CODEC.encoder(message)((value,)), roomy.encoder(message)((value,))
    assert isinstance(payload, bytearray)
    assert payload[:4] == plain[:4]
    assert payload[44 : 44 + len(plain) - 4] == plain[4:]
    assert payload.endswith(TAIL)
    assert (len(payload) % 4, len(payload) - len(plain) - 40 - len(TAIL) < 4) == (0, True)
    for received in (payload, bytes(payload), memoryview(payload)[: -len(TAIL)]):
        (found,) = roomy.decoder(message)(received)
        assert_same(found, value)
    with pytest.raises(DecodeError):
        roomy.decoder(message)(payload + bytes(8))
