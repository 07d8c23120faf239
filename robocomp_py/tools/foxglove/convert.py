"""Messages of RoboComp's types as those that Foxglove's panels draw.

    TImage                         foxglove.RawImage; foxglove.CompressedImage if it is a JPEG file
    TLaserData                     foxglove.LaserScan
    TBaseState                     foxglove.FrameTransform from `map` to the instance
    a sequence of structs x, y, z  foxglove.PointCloud

Types are recognized by the names of their fields, so those of other modules are, too.

RoboComp measures in mm, with x to the right, y up and z ahead (left-handed); angles grow to the right. Foxglove
measures in m, with x ahead, y to the left and z up (right-handed); angles grow to the left. So (x, y, z) becomes
(z, -x, y) / 1000, and an angle its negative. The frame of a message is the instance that publishes it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple, Protocol

import foxglove.messages as fox
import numpy as np

from ...contract.interface import Operation
from ...contract.types import UINT8, Field, Sequence, Struct, Type

MAP = "map"
"""The frame that poses of bases are in."""

M = 0.001
"""Metres in a millimetre."""


class Shown(Protocol):
    """A message of Foxglove's."""

    def encode(self) -> bytes:
        """As Protobuf."""
        ...


Convert = Callable[[Any, int, str], Shown | None]
"""Makes a message of a value, which was sent at a time (ns since 1970) in a frame; None if it cannot be shown."""


class Converter(NamedTuple):
    kinds: tuple[type, ...]
    """The classes of its messages."""
    convert: Convert


def frame_of(topic: str) -> str:
    """The instance that publishes a topic; of a topic with another kind of name, such as `rosout`, its first part."""
    return topic.split("/")[-3:][0]


def converters(operation: Operation[Any]) -> Iterator[tuple[int, Converter]]:
    """The parameters of a topic that can be shown: the number of each, and what converts its values."""
    for number, field in enumerate(operation.inputs):
        if found := _converter(field.type):
            yield number, found


def _converter(kind: Type) -> Converter | None:
    match kind:
        case Struct(fields=fields):
            at = _places(fields)
            if {"compressed", "width", "height", "depth", "image"} <= at.keys() and _is_octets(fields[at["image"]]):
                return Converter((fox.RawImage, fox.CompressedImage), partial(_image, at))
            if {"x", "z", "alpha", "correctedX", "correctedZ", "correctedAlpha"} <= at.keys():
                return Converter((fox.FrameTransform,), partial(_transform, at))
            clouds = [each for each in fields if _is_cloud(each.type)]
            if len(clouds) == 1 and (inner := _converter(clouds[0].type)):
                number, convert = at[clouds[0].name], inner.convert
                return Converter(inner.kinds, lambda value, stamp, frame: convert(value[number], stamp, frame))
        case Sequence(Struct(fields=fields)):
            at = _places(fields)
            if at.keys() == {"angle", "dist"}:
                return Converter((fox.LaserScan,), partial(_scan, at))
            if _is_cloud(kind):
                return Converter((fox.PointCloud,), partial(_cloud, at))
    return None


def _places(fields: tuple[Field, ...]) -> dict[str, int]:
    return {each.name: number for number, each in enumerate(fields)}


def _is_octets(field: Field) -> bool:
    return isinstance(field.type, Sequence) and field.type.item is UINT8


def _is_cloud(kind: Type) -> bool:
    return (
        isinstance(kind, Sequence)
        and isinstance(kind.item, Struct)
        and kind.item.dtype is not None
        and {"x", "y", "z"} <= {each.name for each in kind.item.fields}
    )


def _image(at: dict[str, int], value: Any, stamp: int, frame: str) -> Shown | None:
    width, height, depth = (int(value[at[name]]) for name in ("width", "height", "depth"))
    data = np.asarray(value[at["image"]], np.uint8).tobytes()
    if value[at["compressed"]]:
        return fox.CompressedImage(timestamp=_time(stamp), frame_id=frame, data=data, format="jpeg")
    encoding = {1: "mono8", 3: "rgb8", 4: "rgba8"}.get(depth)
    if encoding is None or not 0 < width < _MOST or not 0 < height < _MOST or len(data) != width * height * depth:
        return None
    return fox.RawImage(
        timestamp=_time(stamp),
        frame_id=frame,
        width=width,
        height=height,
        encoding=encoding,
        step=width * depth,
        data=data,
    )


_MOST = 1 << 16
"""Pixels of a row or column; more make no picture."""


def _transform(at: dict[str, int], value: Any, stamp: int, frame: str) -> Shown | None:
    x, z, alpha = (float(value[at[name]]) for name in ("correctedX", "correctedZ", "correctedAlpha"))
    if not all(map(math.isfinite, (x, z, alpha))):
        return None
    return fox.FrameTransform(
        timestamp=_time(stamp),
        parent_frame_id=MAP,
        child_frame_id=frame,
        translation=fox.Vector3(x=z * M, y=-x * M, z=0.0),
        rotation=_turned(-alpha),
    )


def _scan(at: dict[str, int], value: Any, stamp: int, frame: str) -> Shown | None:
    """Foxglove's beams have equal distances: each of them gets the nearest one of ours."""
    angles, ranges = (np.array([beam[at[name]] for beam in value], np.float64) for name in ("angle", "dist"))
    if not len(angles) or not np.isfinite(angles).all():
        return None
    order = np.argsort(-angles, kind="stable")
    angles, ranges = -angles[order], ranges[order] * M
    even = np.linspace(angles[0], angles[-1], len(angles))
    nearest = np.clip(np.searchsorted((angles[1:] + angles[:-1]) / 2, even), 0, len(angles) - 1)
    return fox.LaserScan(
        timestamp=_time(stamp),
        frame_id=frame,
        pose=_HERE,
        start_angle=float(even[0]),
        end_angle=float(even[-1]),
        ranges=ranges[nearest].tolist(),
        intensities=[],
    )


def _cloud(at: dict[str, int], value: Any, stamp: int, frame: str) -> Shown | None:
    z, x, y = (np.array([point[at[name]] for point in value], np.float64) for name in ("z", "x", "y"))
    points = np.stack([z, -x, y], axis=-1) * M
    return fox.PointCloud(
        timestamp=_time(stamp),
        frame_id=frame,
        pose=_HERE,
        point_stride=12,
        fields=[
            fox.PackedElementField(name=name, offset=4 * number, type=fox.PackedElementFieldNumericType.Float32)
            for number, name in enumerate("xyz")
        ],
        data=points.astype("<f4").tobytes(),
    )


def _time(stamp: int) -> fox.Timestamp:
    return fox.Timestamp(stamp // 1_000_000_000, stamp % 1_000_000_000)


def _turned(yaw: float) -> fox.Quaternion:
    return fox.Quaternion(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))


_HERE = fox.Pose(position=fox.Vector3(x=0.0, y=0.0, z=0.0), orientation=_turned(0.0))
