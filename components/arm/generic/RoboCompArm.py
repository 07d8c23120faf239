# Generated from Arm.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompArm: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import BOOL, FLOAT64, Field, Interface, Operation, Struct


@dataclass(slots=True)
class Pose:
    """Where a tool is: its place in mm, and its rotation Rx·Ry·Rz in rad, seen from the
    root of the scene. Its y leads from the tip of the tool back to the arm: a tool that
    points down is turned about y only.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    rx: float = 0.0
    ry: float = 0.0
    rz: float = 0.0

    __contract__: ClassVar[Struct]


Pose.__contract__ = Struct(
    "RoboCompArm::Pose",
    (
        Field("x", FLOAT64),
        Field("y", FLOAT64),
        Field("z", FLOAT64),
        Field("rx", FLOAT64),
        Field("ry", FLOAT64),
        Field("rz", FLOAT64),
    ),
    Pose,
    doc="Where a tool is: its place in mm, and its rotation Rx·Ry·Rz in rad, seen from the root of the scene.\nIts y leads from the tip of the tool back to the arm: a tool that points down is turned about y only.",  # noqa: E501, RUF100
)

_Arm_move: Operation[None] = Operation(
    "RoboCompArm::Arm",
    "move",
    inputs=(
        Field("goal", Pose.__contract__),
        Field("speed", FLOAT64),
    ),
    doc="Move the tool to a pose, and keep it there. A goal that moves ahead, such as a thing on a belt that runs\nalong z, has a speed (mm/s) and is told again and again.",  # noqa: E501, RUF100
)
_Arm_rest: Operation[None] = Operation(
    "RoboCompArm::Arm",
    "rest",
    doc="Move all joints to their home positions, however the tool moves meanwhile.",
)
_Arm_isThere: Operation[bool] = Operation(
    "RoboCompArm::Arm",
    "isThere",
    outputs=(Field("ret", BOOL),),
    idempotent=True,
    doc="Whether it is where it was told to go.",
)
ARM_INTERFACE = Interface(
    "RoboCompArm::Arm",
    (
        _Arm_move,
        _Arm_rest,
        _Arm_isThere,
    ),
)
