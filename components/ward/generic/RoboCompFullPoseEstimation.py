# Generated from FullPoseEstimation.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompFullPoseEstimation: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import (
    FLOAT32,
    INT32,
    STRING,
    DeclaredError,
    ExceptionType,
    Field,
    Interface,
    Operation,
    Struct,
)


@dataclass(eq=False)
class HardwareFailedException(DeclaredError):
    """What measures the pose is at fault."""

    what: str = ""  # what is wrong, for people

    __contract__: ClassVar[ExceptionType]


HardwareFailedException.__contract__ = ExceptionType(
    "RoboCompFullPoseEstimation::HardwareFailedException",
    (Field("what", STRING, doc="what is wrong, for people"),),
    base=None,
    python=HardwareFailedException,
    doc="What measures the pose is at fault.",
)


@dataclass(slots=True)
class FullPoseMatrix:
    """A pose as a matrix; translations are in m."""

    source: str = ""  # what measures it
    m00: float = 0.0
    m01: float = 0.0
    m02: float = 0.0
    m03: float = 0.0
    m10: float = 0.0
    m11: float = 0.0
    m12: float = 0.0
    m13: float = 0.0
    m20: float = 0.0
    m21: float = 0.0
    m22: float = 0.0
    m23: float = 0.0
    m30: float = 0.0
    m31: float = 0.0
    m32: float = 0.0
    m33: float = 0.0

    __contract__: ClassVar[Struct]


FullPoseMatrix.__contract__ = Struct(
    "RoboCompFullPoseEstimation::FullPoseMatrix",
    (
        Field("source", STRING, doc="what measures it"),
        Field("m00", FLOAT32),
        Field("m01", FLOAT32),
        Field("m02", FLOAT32),
        Field("m03", FLOAT32),
        Field("m10", FLOAT32),
        Field("m11", FLOAT32),
        Field("m12", FLOAT32),
        Field("m13", FLOAT32),
        Field("m20", FLOAT32),
        Field("m21", FLOAT32),
        Field("m22", FLOAT32),
        Field("m23", FLOAT32),
        Field("m30", FLOAT32),
        Field("m31", FLOAT32),
        Field("m32", FLOAT32),
        Field("m33", FLOAT32),
    ),
    FullPoseMatrix,
    doc="A pose as a matrix; translations are in m.",
)


@dataclass(slots=True)
class FullPoseEuler:
    """A pose and its speeds, seen from the world."""

    source: str = ""  # what measures it
    x: float = 0.0  # m
    y: float = 0.0  # m
    z: float = 0.0  # m
    rx: float = 0.0  # rad
    ry: float = 0.0  # rad
    rz: float = 0.0  # rad
    vx: float = 0.0  # m/s
    vy: float = 0.0  # m/s
    vz: float = 0.0  # m/s
    vrx: float = 0.0  # rad/s
    vry: float = 0.0  # rad/s
    vrz: float = 0.0  # rad/s
    adv: float = 0.0  # m/s ahead, seen from the robot
    side: float = 0.0  # m/s to the right, seen from the robot
    rot: float = 0.0  # rad/s to the right, seen from the robot
    confidence: int = 0  # from 0 to 100

    __contract__: ClassVar[Struct]


FullPoseEuler.__contract__ = Struct(
    "RoboCompFullPoseEstimation::FullPoseEuler",
    (
        Field("source", STRING, doc="what measures it"),
        Field("x", FLOAT32, doc="m"),
        Field("y", FLOAT32, doc="m"),
        Field("z", FLOAT32, doc="m"),
        Field("rx", FLOAT32, doc="rad"),
        Field("ry", FLOAT32, doc="rad"),
        Field("rz", FLOAT32, doc="rad"),
        Field("vx", FLOAT32, doc="m/s"),
        Field("vy", FLOAT32, doc="m/s"),
        Field("vz", FLOAT32, doc="m/s"),
        Field("vrx", FLOAT32, doc="rad/s"),
        Field("vry", FLOAT32, doc="rad/s"),
        Field("vrz", FLOAT32, doc="rad/s"),
        Field("adv", FLOAT32, doc="m/s ahead, seen from the robot"),
        Field("side", FLOAT32, doc="m/s to the right, seen from the robot"),
        Field("rot", FLOAT32, doc="rad/s to the right, seen from the robot"),
        Field("confidence", INT32, doc="from 0 to 100"),
    ),
    FullPoseEuler,
    doc="A pose and its speeds, seen from the world.",
)

_FullPoseEstimation_setInitialPose: Operation[None] = Operation(
    "RoboCompFullPoseEstimation::FullPoseEstimation",
    "setInitialPose",
    inputs=(
        Field("x", FLOAT32),
        Field("y", FLOAT32),
        Field("z", FLOAT32),
        Field("rx", FLOAT32),
        Field("ry", FLOAT32),
        Field("rz", FLOAT32),
    ),
    doc="Tell an estimator where it begins: m and rad.",
)
_FullPoseEstimation_getFullPoseEuler: Operation[FullPoseEuler] = Operation(
    "RoboCompFullPoseEstimation::FullPoseEstimation",
    "getFullPoseEuler",
    outputs=(Field("ret", FullPoseEuler.__contract__),),
    doc="The pose and its speeds.",
)
_FullPoseEstimation_getFullPoseMatrix: Operation[FullPoseMatrix] = Operation(
    "RoboCompFullPoseEstimation::FullPoseEstimation",
    "getFullPoseMatrix",
    outputs=(Field("ret", FullPoseMatrix.__contract__),),
    doc="The pose as a matrix.",
)
FULLPOSEESTIMATION_INTERFACE = Interface(
    "RoboCompFullPoseEstimation::FullPoseEstimation",
    (
        _FullPoseEstimation_setInitialPose,
        _FullPoseEstimation_getFullPoseEuler,
        _FullPoseEstimation_getFullPoseMatrix,
    ),
)
