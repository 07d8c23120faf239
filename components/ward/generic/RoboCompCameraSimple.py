# Generated from CameraSimple.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module RoboCompCameraSimple: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import (
    BOOL,
    INT32,
    STRING,
    UINT8,
    DeclaredError,
    ExceptionType,
    Field,
    Interface,
    Operation,
    Sequence,
    Struct,
)


@dataclass(eq=False)
class HardwareFailedException(DeclaredError):
    """The camera gives no picture."""

    what: str = ""  # what is wrong, for people

    __contract__: ClassVar[ExceptionType]


HardwareFailedException.__contract__ = ExceptionType(
    "RoboCompCameraSimple::HardwareFailedException",
    (Field("what", STRING, doc="what is wrong, for people"),),
    base=None,
    python=HardwareFailedException,
    doc="The camera gives no picture.",
)

ImgType: TypeAlias = NDArray[np.uint8]


@dataclass(slots=True)
class TImage:
    """One picture: row after row from the top, the bytes of a pixel together, or a JPEG
    file.
    """

    compressed: bool = False  # whether `image` holds a JPEG file
    width: int = 0  # pixels in a row
    height: int = 0  # rows
    depth: int = 0  # bytes of a pixel: 3 are red, green and blue
    image: ImgType = field(default_factory=lambda: np.empty(0, np.uint8))

    __contract__: ClassVar[Struct]


TImage.__contract__ = Struct(
    "RoboCompCameraSimple::TImage",
    (
        Field("compressed", BOOL, doc="whether `image` holds a JPEG file"),
        Field("width", INT32, doc="pixels in a row"),
        Field("height", INT32, doc="rows"),
        Field("depth", INT32, doc="bytes of a pixel: 3 are red, green and blue"),
        Field("image", Sequence(UINT8)),
    ),
    TImage,
    doc="One picture: row after row from the top, the bytes of a pixel together, or a JPEG file.",  # noqa: E501, RUF100
)

_CameraSimple_getImage: Operation[TImage] = Operation(
    "RoboCompCameraSimple::CameraSimple",
    "getImage",
    outputs=(Field("ret", TImage.__contract__),),
    raises=(HardwareFailedException.__contract__,),
    doc="The newest picture.",
)
CAMERASIMPLE_INTERFACE = Interface(
    "RoboCompCameraSimple::CameraSimple",
    (_CameraSimple_getImage,),
)
