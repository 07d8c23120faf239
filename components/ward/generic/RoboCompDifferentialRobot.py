# Generated from DifferentialRobot.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompDifferentialRobot: types, interfaces and proxies."""

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

    wheelRadius: int = 0  # mm
    axisLength: int = 0  # mm between the wheels
    encoderSteps: int = 0  # steps in a turn of the motor
    gearRatio: int = 0  # turns of the motor in a turn of the wheel
    temp: float = 0.0  # degrees Celsius
    device: str = ""  # where it is connected
    handler: str = ""  # kind of hardware or simulator
    maxVelAdv: float = 0.0  # mm/s
    maxVelRot: float = 0.0  # rad/s

    __contract__: ClassVar[Struct]


TMechParams.__contract__ = Struct(
    "RoboCompDifferentialRobot::TMechParams",
    (
        Field("wheelRadius", INT32, doc="mm"),
        Field("axisLength", INT32, doc="mm between the wheels"),
        Field("encoderSteps", INT32, doc="steps in a turn of the motor"),
        Field("gearRatio", INT32, doc="turns of the motor in a turn of the wheel"),
        Field("temp", FLOAT32, doc="degrees Celsius"),
        Field("device", STRING, doc="where it is connected"),
        Field("handler", STRING, doc="kind of hardware or simulator"),
        Field("maxVelAdv", FLOAT32, doc="mm/s"),
        Field("maxVelRot", FLOAT32, doc="rad/s"),
    ),
    TMechParams,
    doc="How a base is built.",
)

_DifferentialRobot_getBaseState: Operation[RoboCompGenericBase.TBaseState] = Operation(
    "RoboCompDifferentialRobot::DifferentialRobot",
    "getBaseState",
    outputs=(Field("state", RoboCompGenericBase.TBaseState.__contract__),),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Where the base is and how it moves.",
)
_DifferentialRobot_getBasePose: Operation[tuple[int, int, float]] = Operation(
    "RoboCompDifferentialRobot::DifferentialRobot",
    "getBasePose",
    outputs=(
        Field("x", INT32),
        Field("z", INT32),
        Field("alpha", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Where the base is by its odometer: mm, mm, rad.",
)
_DifferentialRobot_setSpeedBase: Operation[None] = Operation(
    "RoboCompDifferentialRobot::DifferentialRobot",
    "setSpeedBase",
    inputs=(
        Field("adv", FLOAT32),
        Field("rot", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Drive with these speeds from now on: mm/s forwards, rad/s to the right.\nRepeat it while driving: a base may stop when no new speeds arrive for a while.",  # noqa: E501, RUF100
)
_DifferentialRobot_stopBase: Operation[None] = Operation(
    "RoboCompDifferentialRobot::DifferentialRobot",
    "stopBase",
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Stand still.",
)
_DifferentialRobot_resetOdometer: Operation[None] = Operation(
    "RoboCompDifferentialRobot::DifferentialRobot",
    "resetOdometer",
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Call the present pose 0, 0, 0.",
)
_DifferentialRobot_setOdometer: Operation[None] = Operation(
    "RoboCompDifferentialRobot::DifferentialRobot",
    "setOdometer",
    inputs=(Field("state", RoboCompGenericBase.TBaseState.__contract__),),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Take pose and best estimate from a state; its speeds do not matter.",
)
_DifferentialRobot_setOdometerPose: Operation[None] = Operation(
    "RoboCompDifferentialRobot::DifferentialRobot",
    "setOdometerPose",
    inputs=(
        Field("x", INT32),
        Field("z", INT32),
        Field("alpha", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Call the present pose this: mm, mm, rad.",
)
_DifferentialRobot_correctOdometer: Operation[None] = Operation(
    "RoboCompDifferentialRobot::DifferentialRobot",
    "correctOdometer",
    inputs=(
        Field("x", INT32),
        Field("z", INT32),
        Field("alpha", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Replace the best estimate, and leave the odometer as it is: mm, mm, rad.",
)
DIFFERENTIALROBOT_INTERFACE = Interface(
    "RoboCompDifferentialRobot::DifferentialRobot",
    (
        _DifferentialRobot_getBaseState,
        _DifferentialRobot_getBasePose,
        _DifferentialRobot_setSpeedBase,
        _DifferentialRobot_stopBase,
        _DifferentialRobot_resetOdometer,
        _DifferentialRobot_setOdometer,
        _DifferentialRobot_setOdometerPose,
        _DifferentialRobot_correctOdometer,
    ),
)
