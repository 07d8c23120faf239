"""The messages of `codecs` as the cyclonedds package has them. Its types do not work with annotations as text."""

from dataclasses import astuple, dataclass
from typing import Any

from cyclonedds.idl import IdlStruct, types

idl: Any = types  # its annotations are no types


@dataclass
class Image(IdlStruct, typename="Image"):
    compressed: bool
    width: idl.int32
    height: idl.int32
    depth: idl.int32
    image: idl.sequence[idl.uint8]


@dataclass
class Scan(IdlStruct, typename="Scan"):
    first: idl.float32
    step: idl.float32
    ranges: idl.sequence[idl.float32]


@dataclass
class Point(IdlStruct, typename="Point"):
    x: idl.float32
    y: idl.float32
    z: idl.float32


@dataclass
class Cloud(IdlStruct, typename="Cloud"):
    points: idl.sequence[Point]


@dataclass
class BaseState(IdlStruct, typename="BaseState"):
    x: idl.float32
    correctedX: idl.float32
    z: idl.float32
    correctedZ: idl.float32
    alpha: idl.float32
    correctedAlpha: idl.float32
    advVx: idl.float32
    advVz: idl.float32
    rotV: idl.float32
    isMoving: bool


def sample(message: Any) -> tuple[Any, Any]:
    """The class of that name, and the same message of it, in the form that is quickest."""
    name = type(message).__name__
    if name == "Cloud":
        return Cloud, Cloud([Point(*astuple(point)) for point in message.points])
    values = [getattr(message, each) for each in message.__slots__]
    if name == "Image":
        values[-1] = message.image.tobytes()
    if name == "Scan":
        values[-1] = message.ranges.tolist()
    kind = globals()[name]
    return kind, kind(*values)
