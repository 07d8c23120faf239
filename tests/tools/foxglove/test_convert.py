"""Messages of RoboComp's types as Foxglove gets them: units, axes, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from foxglove import messages as fox

from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import BOOL, FLOAT32, INT32, UINT8, Field, Sequence, Struct
from robocomp_py.tools.foxglove.convert import converters
from robocomp_py.wire.cdr import Cdr

STAMP = 1_500_000_000_000_000_007
IMAGE = Struct(
    "RoboCompCameraSimple::TImage",
    (
        Field("compressed", BOOL),
        *(Field(name, INT32) for name in ("width", "height", "depth")),
        Field("image", Sequence(UINT8)),
    ),
)
SCAN = Sequence(Struct("RoboCompLaser::TData", (Field("angle", FLOAT32), Field("dist", FLOAT32))))
STATE = Struct(
    "RoboCompGenericBase::TBaseState",
    tuple(Field(name, FLOAT32) for name in ("x", "correctedX", "z", "correctedZ", "alpha", "correctedAlpha")),
)
POINTS = Sequence(Struct("RoboCompLidar::TPoint", tuple(Field(name, FLOAT32) for name in ("x", "y", "z", "r"))))
CLOUD = Struct("RoboCompLidar::TData", (Field("points", POINTS), Field("period", FLOAT32)))


def shown(kind: Any, value: Any) -> Any:
    """What the parameter of a topic becomes, as it is decoded from a message."""
    operation = Operation[Any]("House::Sensor", "push", (Field("data", kind),))
    ((number, found),) = converters(operation)
    octets = Cdr().encoder(operation.request)((value,))
    message = found.convert(Cdr().decoder(operation.request)(octets)[number], STAMP, "world")
    assert message is None or type(message) in found.kinds
    return message


def test_a_picture_keeps_its_octets() -> None:
    data = bytes(range(2 * 1 * 3))
    found = shown(IMAGE, (False, 2, 1, 3, data))
    assert isinstance(found, fox.RawImage)
    expected = fox.RawImage(
        timestamp=fox.Timestamp(1_500_000_000, 7),
        frame_id="world",
        width=2,
        height=1,
        encoding="rgb8",
        step=6,
        data=data,
    )
    assert found.encode() == expected.encode()


def test_a_jpeg_file_stays_one() -> None:
    found = shown(IMAGE, (True, 2, 1, 3, b"\xff\xd8\xff"))
    assert isinstance(found, fox.CompressedImage)
    assert b"jpeg" in found.encode()


@pytest.mark.parametrize(
    "image",
    [(False, 2, 1, 3, b"12345"), (False, -2, -1, 3, b"123456"), (False, 1, 1, 7, b"1234567"), (False, 0, 0, 3, b"")],
)
def test_a_picture_of_another_size_is_not_shown(image: tuple[Any, ...]) -> None:
    assert shown(IMAGE, image) is None


def test_a_scan_turns_to_the_left_and_is_in_metres() -> None:
    beams = [(-0.5, 1000.0), (0.0, 2000.0), (0.5, 3000.0)]  # from the left to the right
    found = shown(SCAN, beams)
    assert isinstance(found, fox.LaserScan)
    assert found.encode() == scan(-0.5, 0.5, [3.0, 2.0, 1.0])
    assert shown(SCAN, beams[::-1]).encode() == found.encode()


def scan(start: float, end: float, ranges: list[float]) -> bytes:
    here = fox.Pose(position=fox.Vector3(x=0.0, y=0.0, z=0.0), orientation=fox.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))
    return fox.LaserScan(
        timestamp=fox.Timestamp(1_500_000_000, 7),
        frame_id="world",
        pose=here,
        start_angle=start,
        end_angle=end,
        ranges=ranges,
        intensities=[],
    ).encode()


def test_beams_at_unequal_angles_stay_at_their_places() -> None:
    found = shown(SCAN, [(0.0, 1000.0), (0.25, 2000.0), (1.0, 3000.0)])
    assert found.encode() == scan(-1.0, 0.0, [3.0, 2.0, 1.0])
    found = shown(SCAN, [(0.0, 1000.0), (0.125, 2000.0), (0.25, 3000.0), (1.5, 4000.0)])
    assert found.encode() == scan(-1.5, 0.0, [4.0, 4.0, 3.0, 1.0])


def test_a_scan_without_beams_is_not_shown() -> None:
    assert shown(SCAN, []) is None
    assert shown(SCAN, [(math.nan, 1.0)]) is None


def test_a_pose_is_a_transform_of_the_right_handed_frame() -> None:
    right = float(np.float32(math.pi / 2))
    found = shown(STATE, (0.0, 1000.0, 0.0, 2000.0, 0.0, right))  # 1 m to the right, 2 m ahead
    expected = fox.FrameTransform(
        timestamp=fox.Timestamp(1_500_000_000, 7),
        parent_frame_id="map",
        child_frame_id="world",
        translation=fox.Vector3(x=2.0, y=-1.0, z=0.0),
        rotation=fox.Quaternion(x=0.0, y=0.0, z=-math.sin(right / 2), w=math.cos(right / 2)),
    )
    assert found.encode() == expected.encode()
    assert shown(STATE, (0.0, math.inf, 0.0, 0.0, 0.0, 0.0)) is None


@pytest.mark.parametrize("kind", [POINTS, CLOUD])
def test_points_are_in_metres(kind: Any) -> None:
    points = [(1000.0, 2000.0, 3000.0, 9.0), (-1000.0, 0.0, 500.0, 9.0)]
    found = shown(kind, points if kind is POINTS else (points, 0.1))
    assert isinstance(found, fox.PointCloud)
    assert np.array([[3, -1, 2], [0.5, 1, 0]], "<f4").tobytes() in found.encode()


def test_other_types_are_not_converted() -> None:
    fields = (Field("data", Sequence(FLOAT32)), Field("flag", BOOL))
    assert list(converters(Operation[Any]("House::Sensor", "push", fields))) == []
