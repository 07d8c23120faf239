# Generated from Arm.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompArm: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import (
    BOOL,
    FLOAT64,
    Field,
    Future,
    Interface,
    Operation,
    Proxy,
    Struct,
)


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


class ArmProxy(Proxy):
    """Calls Arm of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = ARM_INTERFACE

    def move(self, goal: Pose, speed: float, *, deadline: float | None = None) -> None:
        """Move the tool to a pose, and keep it there. A goal that moves ahead, such as
        a thing on a belt that runs along z, has a speed (mm/s) and is told again and
        again.

        IDSL: void move(Pose goal, double speed)
        """
        return self._ask(_Arm_move, (goal, speed), deadline)

    def moveAsync(
        self,
        goal: Pose,
        speed: float,
        *,
        deadline: float | None = None,
    ) -> Future[None]:
        """Call `move` without waiting. The Future is done within the deadline."""
        return self._ask_async(_Arm_move, (goal, speed), deadline)

    def rest(self, *, deadline: float | None = None) -> None:
        """Move all joints to their home positions, however the tool moves meanwhile.

        IDSL: void rest()
        """
        return self._ask(_Arm_rest, (), deadline)

    def restAsync(self, *, deadline: float | None = None) -> Future[None]:
        """Call `rest` without waiting. The Future is done within the deadline."""
        return self._ask_async(_Arm_rest, (), deadline)

    def isThere(self, *, deadline: float | None = None) -> bool:
        """Whether it is where it was told to go.

        IDSL: idempotent bool isThere()
        """
        return self._ask(_Arm_isThere, (), deadline)

    def isThereAsync(self, *, deadline: float | None = None) -> Future[bool]:
        """Call `isThere` without waiting. The Future is done within the deadline."""
        return self._ask_async(_Arm_isThere, (), deadline)
