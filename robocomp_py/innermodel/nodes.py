"""The tags of an InnerModel file and their attributes: one table, from which files are read, written and explained.

Lengths are in mm and angles in rad, unless the text of an attribute says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

ROOT = "innermodel"
"""The tag of the root, in lower case. The case of tags does not matter."""

INCLUDE = "include"
"""The tag that stands for the nodes of another file."""

MESH_FORMATS = ("obj", "dae", "stl", "ply", "off", "glb", "gltf", "osg", "3ds")
"""The endings of files that a mesh is read from."""

MOST_DEPTH = 200
"""The deepest nesting of nodes; files of real robots have at most 40."""


Value = float | int | bool | str | tuple[float, ...]
"""Of an attribute."""


class Kind(Enum):
    """What the text of an attribute is."""

    NUMBER = "a number"
    COUNT = "a whole number"
    NUMBERS = "numbers with commas between them"
    TEXT = "a text"
    FLAG = "0 or 1"
    AXIS = "`x`, `y` or `z`"
    ENGINE = "`static` or `bullet`"
    RENDER = "`normal` or `wireframe`"


CHOICES: Mapping[Kind, tuple[str, ...]] = {
    Kind.AXIS: ("x", "y", "z"),
    Kind.ENGINE: ("static", "bullet"),
    Kind.RENDER: ("normal", "wireframe"),
}


@dataclass(frozen=True, slots=True)
class Attribute:
    name: str
    kind: Kind
    default: Value
    text: str
    """What it means, for editors."""


@dataclass(frozen=True, slots=True)
class Tag:
    name: str
    text: str
    """What it is, for editors."""
    attributes: Mapping[str, Attribute]
    has_children: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "attributes", MappingProxyType(dict(self.attributes)))


def _attributes(*every: Attribute) -> dict[str, Attribute]:
    return {each.name: each for each in every}


def _number(name: str, text: str, default: float = 0.0) -> Attribute:
    return Attribute(name, Kind.NUMBER, default, text)


def _count(name: str, text: str, default: int = 0) -> Attribute:
    return Attribute(name, Kind.COUNT, default, text)


def _numbers(name: str, text: str, default: tuple[float, ...]) -> Attribute:
    return Attribute(name, Kind.NUMBERS, default, text)


def _text(name: str, text: str, kind: Kind = Kind.TEXT, default: str = "") -> Attribute:
    return Attribute(name, kind, default, text)


_ID = _text("id", "its name, which no other node has")
_PORT = _count("port", "the port on which it is served; 0: none")
_COLLIDE = Attribute("collide", Kind.FLAG, False, "whether it stops robots while physics is off")
_IFCONFIG = _text(
    "ifconfig",
    "ports of what carries it: of an rgbd, those of joints and base, `10067,10004`; of a laser, that of the base",
)
_NOISE = _number(
    "noise", "standard deviation of its noise: of a base, as a part of its speed; of an rgbd, as a part of its depths"
)

_TRANSLATION = tuple(_number(f"t{axis}", f"translation along {axis}, mm") for axis in "xyz")
_ROTATION = tuple(_number(f"r{axis}", f"rotation about {axis}, rad") for axis in "xyz")
_BODY = (
    _text("engine", "`static`, or `bullet` for a body that moves freely", Kind.ENGINE, "static"),
    _number("mass", "mass in kg"),
)
_JOINT = (
    _text("axis", "the axis that it moves about, or along", Kind.AXIS, "z"),
    _number("min", "lowest position, rad, or mm if it slides", -math.inf),
    _number("max", "highest position, rad, or mm if it slides", math.inf),
    _number("home", "position that `setZeroPos` moves it to, rad, or mm if it slides"),
    _PORT,
)
_WITHOUT_EFFECT = tuple(_number(f"{end}{axis}", "without effect") for end in "lh" for axis in "xyz")
_SURFACE = (
    _text("texture", "a file with a picture, or a colour as `#rrggbb`"),
    _count("repeat", "without effect: every side has the whole picture", 1000),
    _numbers(
        "size",
        "width, height and depth of the box (of one or two numbers, its depth is a hundredth of the smaller), mm",
        (2500.0,),
    ),
    *(_number(f"n{axis}", f"the part {axis} of its normal") for axis in "xyz"),
    *(_number(f"p{axis}", f"the part {axis} of its centre, mm") for axis in "xyz"),
)
_CAMERA = (
    _count("width", "columns of the picture, pixels"),
    _count("height", "rows of the picture, pixels"),
    _number("focal", "focal length, pixels"),
)

_ALL = (
    Tag(ROOT, "the root of a model", {}, has_children=True),
    Tag("transform", "a frame", _attributes(_ID, *_TRANSLATION, *_ROTATION, *_BODY), has_children=True),
    Tag("translation", "a frame that is moved", _attributes(_ID, *_TRANSLATION, *_BODY), has_children=True),
    Tag("rotation", "a frame that is turned", _attributes(_ID, *_ROTATION, *_BODY), has_children=True),
    Tag(
        "joint",
        "a frame that turns about an axis, after its offset",
        _attributes(_ID, *_TRANSLATION, *_ROTATION, *_JOINT, *_WITHOUT_EFFECT),
        has_children=True,
    ),
    Tag(
        "prismaticjoint",
        "a frame that slides along an axis",
        _attributes(
            _ID,
            *_JOINT,
            _number("position", "position when the file is read, mm"),
            _number("offset", "what is added to the position, mm"),
        ),
        has_children=True,
    ),
    *(
        Tag(
            name,
            text,
            _attributes(_ID, *_TRANSLATION, *_ROTATION, _PORT, _NOISE, _COLLIDE),
            has_children=True,
        )
        for name, text in (
            ("differentialrobot", "a base with two wheels; it moves in x and z of its parent and turns about y"),
            ("omnirobot", "a base that also moves sideways; it turns about y of its parent"),
        )
    ),
    Tag(
        "laser",
        "a laser scanner in the plane of x and z",
        _attributes(
            _ID,
            _PORT,
            _number("min", "shortest distance, mm"),
            _number("max", "longest distance, mm"),
            _number("angle", "the whole field of view, rad"),
            _count("measures", "number of rays"),
            _IFCONFIG,
        ),
    ),
    Tag("rgbd", "a camera that also sees depth", _attributes(_ID, _PORT, *_CAMERA, _NOISE, _IFCONFIG)),
    Tag("camera", "a camera", _attributes(_ID, *_CAMERA)),
    Tag("imu", "an inertial unit", _attributes(_ID, _PORT)),
    Tag(
        "touchsensor",
        "a sensor of contact",
        _attributes(
            _ID,
            _text("type", "`bumper` for contact; else it measures the force along its normal"),
            *(_number(f"n{axis}", f"the part {axis} of its normal") for axis in "xyz"),
            _number("min", "lowest value, N", -math.inf),
            _number("max", "highest value, N", math.inf),
            _PORT,
        ),
        has_children=True,
    ),
    Tag(
        "mesh",
        "a shape that is read from a file",
        _attributes(
            _ID,
            _text("file", "the file of the shape"),
            _numbers("scale", "what its coordinates are multiplied by: one number, or one for each axis", (1.0,)),
            _text("render", "how it is drawn", Kind.RENDER, "normal"),
            *_TRANSLATION,
            *_ROTATION,
            _COLLIDE,
        ),
    ),
    Tag("plane", "a box with a texture", _attributes(_ID, *_SURFACE, _COLLIDE)),
    Tag("display", "a box that shows the picture that it is sent", _attributes(_ID, *_SURFACE, _PORT, _COLLIDE)),
    Tag("pointcloud", "points that a component sets", _attributes(_ID)),
    Tag(
        "axes",
        "three arrows that show a frame",
        _attributes(
            _ID,
            _number("length", "length of the arrows, mm", 200.0),
            _number("width", "width of the arrows, mm", 15.0),
            *(_number(f"{what}{axis}", "without effect") for axis in "xyz" for what in ("length", "width")),
        ),
    ),
    Tag(INCLUDE, "the nodes of another file", _attributes(_text("path", "the file, relative to this one"))),
)

DEVICES = frozenset(
    ("laser", "differentialrobot", "omnirobot", "imu", "touchsensor", "rgbd", "camera", "display"),
)
"""Tags of nodes that a simulation provides under their ids."""

TAGS: Mapping[str, Tag] = MappingProxyType({each.name: each for each in _ALL})
"""All tags by their names in lower case."""
