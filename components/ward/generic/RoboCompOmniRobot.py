# Generated from OmniRobot.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompOmniRobot: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import (
    FLOAT32,
    INT32,
    STRING,
    Field,
    Interface,
    Operation,
    Struct,
)

from . import RoboCompGenericBase


@dataclass(slots=True)
class TMechParams:
    """How a base is built."""

    temp: float = 0.0  # degrees Celsius
    device: str = ""  # where it is connected
    handler: str = ""  # kind of hardware or simulator
    maxVelAdv: float = 0.0  # mm/s
    maxVelRot: float = 0.0  # rad/s

    __contract__: ClassVar[Struct]


TMechParams.__contract__ = Struct(
    "RoboCompOmniRobot::TMechParams",
    (
        Field("temp", FLOAT32, doc="degrees Celsius"),
        Field("device", STRING, doc="where it is connected"),
        Field("handler", STRING, doc="kind of hardware or simulator"),
        Field("maxVelAdv", FLOAT32, doc="mm/s"),
        Field("maxVelRot", FLOAT32, doc="rad/s"),
    ),
    TMechParams,
    doc="How a base is built.",
)

_OmniRobot_getBaseState: Operation[RoboCompGenericBase.TBaseState] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "getBaseState",
    outputs=(Field("state", RoboCompGenericBase.TBaseState.__contract__),),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Where the base is and how it moves.",
)
_OmniRobot_getBasePose: Operation[tuple[int, int, float]] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "getBasePose",
    outputs=(
        Field("x", INT32),
        Field("z", INT32),
        Field("alpha", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Where the base is by its odometer: mm, mm, rad.",
)
_OmniRobot_setSpeedBase: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "setSpeedBase",
    inputs=(
        Field("advx", FLOAT32),
        Field("advz", FLOAT32),
        Field("rot", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Drive with these speeds from now on: mm/s to the right, mm/s forwards, rad/s to the right.\nRepeat it while driving: a base may stop when no new speeds arrive for a while.",  # noqa: E501, RUF100
)
_OmniRobot_stopBase: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "stopBase",
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Stand still.",
)
_OmniRobot_resetOdometer: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "resetOdometer",
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Call the present pose 0, 0, 0.",
)
_OmniRobot_setOdometer: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "setOdometer",
    inputs=(Field("state", RoboCompGenericBase.TBaseState.__contract__),),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Take pose and best estimate from a state; its speeds do not matter.",
)
_OmniRobot_setOdometerPose: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "setOdometerPose",
    inputs=(
        Field("x", INT32),
        Field("z", INT32),
        Field("alpha", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Call the present pose this: mm, mm, rad.",
)
_OmniRobot_correctOdometer: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "correctOdometer",
    inputs=(
        Field("x", INT32),
        Field("z", INT32),
        Field("alpha", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Replace the best estimate, and leave the odometer as it is: mm, mm, rad.",
)
OMNIROBOT_INTERFACE = Interface(
    "RoboCompOmniRobot::OmniRobot",
    (
        _OmniRobot_getBaseState,
        _OmniRobot_getBasePose,
        _OmniRobot_setSpeedBase,
        _OmniRobot_stopBase,
        _OmniRobot_resetOdometer,
        _OmniRobot_setOdometer,
        _OmniRobot_setOdometerPose,
        _OmniRobot_correctOdometer,
    ),
)
