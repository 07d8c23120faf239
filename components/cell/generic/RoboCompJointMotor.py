# Generated from JointMotor.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module RoboCompJointMotor: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from robocomp_py.runtime.api import (
    BOOL,
    FLOAT32,
    INT32,
    STRING,
    UINT8,
    DeclaredError,
    Dictionary,
    ExceptionType,
    Field,
    Interface,
    Operation,
    Sequence,
    Struct,
)


@dataclass(eq=False)
class HardwareFailedException(DeclaredError):
    """A motor itself is at fault, or cannot do what it is told."""

    what: str = ""  # what is wrong, for people

    __contract__: ClassVar[ExceptionType]


HardwareFailedException.__contract__ = ExceptionType(
    "RoboCompJointMotor::HardwareFailedException",
    (Field("what", STRING, doc="what is wrong, for people"),),
    base=None,
    python=HardwareFailedException,
    doc="A motor itself is at fault, or cannot do what it is told.",
)


@dataclass(eq=False)
class OutOfRangeException(DeclaredError):
    """A goal lies outside of what a motor can reach."""

    what: str = ""  # which motor, and how far it goes, for people

    __contract__: ClassVar[ExceptionType]


OutOfRangeException.__contract__ = ExceptionType(
    "RoboCompJointMotor::OutOfRangeException",
    (Field("what", STRING, doc="which motor, and how far it goes, for people"),),
    base=None,
    python=OutOfRangeException,
    doc="A goal lies outside of what a motor can reach.",
)


@dataclass(eq=False)
class UnknownMotorException(DeclaredError):
    """There is no motor of this name."""

    what: str = ""  # which names there are, for people

    __contract__: ClassVar[ExceptionType]


UnknownMotorException.__contract__ = ExceptionType(
    "RoboCompJointMotor::UnknownMotorException",
    (Field("what", STRING, doc="which names there are, for people"),),
    base=None,
    python=UnknownMotorException,
    doc="There is no motor of this name.",
)


@dataclass(eq=False)
class CollisionException(DeclaredError):
    """The motion would end in a collision."""

    what: str = ""  # what would collide, for people

    __contract__: ClassVar[ExceptionType]


CollisionException.__contract__ = ExceptionType(
    "RoboCompJointMotor::CollisionException",
    (Field("what", STRING, doc="what would collide, for people"),),
    base=None,
    python=CollisionException,
    doc="The motion would end in a collision.",
)


@dataclass(slots=True)
class MotorState:
    """What a motor does now."""

    pos: float = 0.0  # rad, or mm
    vel: float = 0.0  # rad/s, or mm/s
    power: float = 0.0  # what it consumes; the unit is that of the hardware
    timeStamp: str = ""  # when this was so, as the motor's own clock writes it
    p: int = 0  # steps of the encoder
    v: int = 0  # steps of the encoder per second
    isMoving: bool = False  # whether its speed is not 0
    temperature: int = 0  # degrees Celsius

    __contract__: ClassVar[Struct]


MotorState.__contract__ = Struct(
    "RoboCompJointMotor::MotorState",
    (
        Field("pos", FLOAT32, doc="rad, or mm"),
        Field("vel", FLOAT32, doc="rad/s, or mm/s"),
        Field(
            "power",
            FLOAT32,
            doc="what it consumes; the unit is that of the hardware",
        ),
        Field(
            "timeStamp",
            STRING,
            doc="when this was so, as the motor's own clock writes it",
        ),
        Field("p", INT32, doc="steps of the encoder"),
        Field("v", INT32, doc="steps of the encoder per second"),
        Field("isMoving", BOOL, doc="whether its speed is not 0"),
        Field("temperature", INT32, doc="degrees Celsius"),
    ),
    MotorState,
    doc="What a motor does now.",
)

MotorStateMap: TypeAlias = dict[str, MotorState]


@dataclass(slots=True)
class MotorParams:
    """How a motor is built and set."""

    name: str = ""  # which motor this is
    busId: int = 0  # its address on the bus
    minPos: float = 0.0  # rad, or mm; the lowest position
    maxPos: float = 0.0  # rad, or mm; the highest position
    maxVelocity: float = 0.0  # rad/s, or mm/s
    zeroPos: float = 0.0  # rad, or mm; where setZeroPos moves it
    stepsRange: float = 0.0  # steps of the encoder over its range
    maxDegrees: float = 0.0  # out of date; see unitsRange
    invertedSign: bool = False  # out of date; see unitsRange
    offset: float = 0.0  # steps of the encoder at position 0
    unitsRange: float = 0.0  # rad, or mm, over its range

    __contract__: ClassVar[Struct]


MotorParams.__contract__ = Struct(
    "RoboCompJointMotor::MotorParams",
    (
        Field("name", STRING, doc="which motor this is"),
        Field("busId", UINT8, doc="its address on the bus"),
        Field("minPos", FLOAT32, doc="rad, or mm; the lowest position"),
        Field("maxPos", FLOAT32, doc="rad, or mm; the highest position"),
        Field("maxVelocity", FLOAT32, doc="rad/s, or mm/s"),
        Field("zeroPos", FLOAT32, doc="rad, or mm; where setZeroPos moves it"),
        Field("stepsRange", FLOAT32, doc="steps of the encoder over its range"),
        Field("maxDegrees", FLOAT32, doc="out of date; see unitsRange"),
        Field("invertedSign", BOOL, doc="out of date; see unitsRange"),
        Field("offset", FLOAT32, doc="steps of the encoder at position 0"),
        Field("unitsRange", FLOAT32, doc="rad, or mm, over its range"),
    ),
    MotorParams,
    doc="How a motor is built and set.",
)

MotorParamsList: TypeAlias = list[MotorParams]


@dataclass(slots=True)
class BusParams:
    """The bus that connects the motors."""

    handler: str = ""  # kind of hardware or simulator
    device: str = ""  # where it is connected
    numMotors: int = 0  # how many motors it has
    baudRate: int = 0  # bits per second
    basicPeriod: int = 0  # ms between two exchanges with the motors

    __contract__: ClassVar[Struct]


BusParams.__contract__ = Struct(
    "RoboCompJointMotor::BusParams",
    (
        Field("handler", STRING, doc="kind of hardware or simulator"),
        Field("device", STRING, doc="where it is connected"),
        Field("numMotors", INT32, doc="how many motors it has"),
        Field("baudRate", INT32, doc="bits per second"),
        Field("basicPeriod", INT32, doc="ms between two exchanges with the motors"),
    ),
    BusParams,
    doc="The bus that connects the motors.",
)


@dataclass(slots=True)
class MotorGoalPosition:
    """Where a motor is to go."""

    name: str = ""  # which motor
    position: float = 0.0  # rad, or mm
    maxSpeed: float = 0.0  # rad/s, or mm/s; 0: as fast as it can

    __contract__: ClassVar[Struct]


MotorGoalPosition.__contract__ = Struct(
    "RoboCompJointMotor::MotorGoalPosition",
    (
        Field("name", STRING, doc="which motor"),
        Field("position", FLOAT32, doc="rad, or mm"),
        Field("maxSpeed", FLOAT32, doc="rad/s, or mm/s; 0: as fast as it can"),
    ),
    MotorGoalPosition,
    doc="Where a motor is to go.",
)

MotorGoalPositionList: TypeAlias = list[MotorGoalPosition]


@dataclass(slots=True)
class MotorGoalVelocity:
    """How fast a motor is to move."""

    name: str = ""  # which motor
    velocity: float = 0.0  # rad/s, or mm/s
    maxAcc: float = 0.0  # rad/s^2, or mm/s^2; 0: as fast as it can

    __contract__: ClassVar[Struct]


MotorGoalVelocity.__contract__ = Struct(
    "RoboCompJointMotor::MotorGoalVelocity",
    (
        Field("name", STRING, doc="which motor"),
        Field("velocity", FLOAT32, doc="rad/s, or mm/s"),
        Field("maxAcc", FLOAT32, doc="rad/s^2, or mm/s^2; 0: as fast as it can"),
    ),
    MotorGoalVelocity,
    doc="How fast a motor is to move.",
)

MotorGoalVelocityList: TypeAlias = list[MotorGoalVelocity]

MotorList: TypeAlias = list[str]

_JointMotor_setPosition: Operation[None] = Operation(
    "RoboCompJointMotor::JointMotor",
    "setPosition",
    inputs=(Field("goal", MotorGoalPosition.__contract__),),
    raises=(
        UnknownMotorException.__contract__,
        HardwareFailedException.__contract__,
        CollisionException.__contract__,
    ),
    doc="Move a motor to a position, and hold it there.",
)
_JointMotor_setVelocity: Operation[None] = Operation(
    "RoboCompJointMotor::JointMotor",
    "setVelocity",
    inputs=(Field("goal", MotorGoalVelocity.__contract__),),
    raises=(
        UnknownMotorException.__contract__,
        HardwareFailedException.__contract__,
    ),
    doc="Move a motor at a speed until it is told otherwise, or reaches an end.",
)
_JointMotor_setZeroPos: Operation[None] = Operation(
    "RoboCompJointMotor::JointMotor",
    "setZeroPos",
    inputs=(Field("name", STRING),),
    raises=(
        UnknownMotorException.__contract__,
        HardwareFailedException.__contract__,
    ),
    doc="Move a motor to its zero position.",
)
_JointMotor_setSyncPosition: Operation[None] = Operation(
    "RoboCompJointMotor::JointMotor",
    "setSyncPosition",
    inputs=(Field("listGoals", Sequence(MotorGoalPosition.__contract__)),),
    raises=(
        UnknownMotorException.__contract__,
        HardwareFailedException.__contract__,
    ),
    doc="Move several motors to positions. They start together, or none of them does.",
)
_JointMotor_setSyncVelocity: Operation[None] = Operation(
    "RoboCompJointMotor::JointMotor",
    "setSyncVelocity",
    inputs=(Field("listGoals", Sequence(MotorGoalVelocity.__contract__)),),
    raises=(
        UnknownMotorException.__contract__,
        HardwareFailedException.__contract__,
    ),
    doc="Move several motors at speeds. They start together, or none of them does.",
)
_JointMotor_setSyncZeroPos: Operation[None] = Operation(
    "RoboCompJointMotor::JointMotor",
    "setSyncZeroPos",
    raises=(
        UnknownMotorException.__contract__,
        HardwareFailedException.__contract__,
    ),
    doc="Move all motors to their zero positions.",
)
_JointMotor_getMotorParams: Operation[MotorParams] = Operation(
    "RoboCompJointMotor::JointMotor",
    "getMotorParams",
    inputs=(Field("motor", STRING),),
    outputs=(Field("ret", MotorParams.__contract__),),
    raises=(UnknownMotorException.__contract__,),
    doc="How a motor is built and set.",
)
_JointMotor_getMotorState: Operation[MotorState] = Operation(
    "RoboCompJointMotor::JointMotor",
    "getMotorState",
    inputs=(Field("motor", STRING),),
    outputs=(Field("ret", MotorState.__contract__),),
    raises=(UnknownMotorException.__contract__,),
    doc="What a motor does now.",
)
_JointMotor_getMotorStateMap: Operation[MotorStateMap] = Operation(
    "RoboCompJointMotor::JointMotor",
    "getMotorStateMap",
    inputs=(Field("mList", Sequence(STRING)),),
    outputs=(
        Field(
            "ret",
            Dictionary(
                STRING,
                MotorState.__contract__,
                "RoboCompJointMotor::MotorStateMap",
            ),
        ),
    ),
    raises=(UnknownMotorException.__contract__,),
    doc="What the motors of a list do now.",
)
_JointMotor_getAllMotorState: Operation[MotorStateMap] = Operation(
    "RoboCompJointMotor::JointMotor",
    "getAllMotorState",
    outputs=(
        Field(
            "mstateMap",
            Dictionary(
                STRING,
                MotorState.__contract__,
                "RoboCompJointMotor::MotorStateMap",
            ),
        ),
    ),
    raises=(UnknownMotorException.__contract__,),
    doc="What all motors do now.",
)
_JointMotor_getAllMotorParams: Operation[MotorParamsList] = Operation(
    "RoboCompJointMotor::JointMotor",
    "getAllMotorParams",
    outputs=(Field("ret", Sequence(MotorParams.__contract__)),),
    doc="How all motors are built and set.",
)
_JointMotor_getBusParams: Operation[BusParams] = Operation(
    "RoboCompJointMotor::JointMotor",
    "getBusParams",
    outputs=(Field("ret", BusParams.__contract__),),
    doc="How the bus is set.",
)
JOINTMOTOR_INTERFACE = Interface(
    "RoboCompJointMotor::JointMotor",
    (
        _JointMotor_setPosition,
        _JointMotor_setVelocity,
        _JointMotor_setZeroPos,
        _JointMotor_setSyncPosition,
        _JointMotor_setSyncVelocity,
        _JointMotor_setSyncZeroPos,
        _JointMotor_getMotorParams,
        _JointMotor_getMotorState,
        _JointMotor_getMotorStateMap,
        _JointMotor_getAllMotorState,
        _JointMotor_getAllMotorParams,
        _JointMotor_getBusParams,
    ),
)

_JointMotorPublish_motorStates: Operation[None] = Operation(
    "RoboCompJointMotor::JointMotorPublish",
    "motorStates",
    inputs=(
        Field(
            "mstateMap",
            Dictionary(
                STRING,
                MotorState.__contract__,
                "RoboCompJointMotor::MotorStateMap",
            ),
        ),
    ),
    doc="What all motors do now.",
)
JOINTMOTORPUBLISH_INTERFACE = Interface(
    "RoboCompJointMotor::JointMotorPublish",
    (_JointMotorPublish_motorStates,),
)
