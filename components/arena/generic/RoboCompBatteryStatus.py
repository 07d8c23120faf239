# Generated from BatteryStatus.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompBatteryStatus: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from robocomp_py.runtime.api import (
    FLOAT32,
    STRING,
    DeclaredError,
    Enumeration,
    ExceptionType,
    Field,
    Interface,
    Operation,
    Struct,
)


@dataclass(eq=False)
class HardwareFailedException(DeclaredError):
    """The battery cannot be measured."""

    what: str = ""  # what is wrong, for people

    __contract__: ClassVar[ExceptionType]


HardwareFailedException.__contract__ = ExceptionType(
    "RoboCompBatteryStatus::HardwareFailedException",
    (Field("what", STRING, doc="what is wrong, for people"),),
    base=None,
    python=HardwareFailedException,
    doc="The battery cannot be measured.",
)


class BatteryStates(IntEnum):
    """Whether a charger is connected, and whether it has done its work."""

    Charging = 0
    Charged = 1
    Disconnected = 2

    __contract__: ClassVar[Enumeration]


BatteryStates.__contract__ = Enumeration(
    "RoboCompBatteryStatus::BatteryStates",
    (
        ("Charging", 0),
        ("Charged", 1),
        ("Disconnected", 2),
    ),
    BatteryStates,
)


@dataclass(slots=True)
class TBattery:
    """What a battery holds, and what flows."""

    percentage: float = 0.0  # 0 to 100
    state: BatteryStates = BatteryStates.Charging  # Disconnected: it feeds the robot
    voltage: float = 0.0  # V
    current: float = 0.0  # A, positive when charging
    timeToGo: float = 0.0  # s until it is empty, or full when charging
    power: float = 0.0  # W, positive when charging
    consumptionPerHour: float = 0.0  # Wh that an hour like the present moment takes

    __contract__: ClassVar[Struct]


TBattery.__contract__ = Struct(
    "RoboCompBatteryStatus::TBattery",
    (
        Field("percentage", FLOAT32, doc="0 to 100"),
        Field(
            "state",
            BatteryStates.__contract__,
            doc="Disconnected: it feeds the robot",
        ),
        Field("voltage", FLOAT32, doc="V"),
        Field("current", FLOAT32, doc="A, positive when charging"),
        Field("timeToGo", FLOAT32, doc="s until it is empty, or full when charging"),
        Field("power", FLOAT32, doc="W, positive when charging"),
        Field(
            "consumptionPerHour",
            FLOAT32,
            doc="Wh that an hour like the present moment takes",
        ),
    ),
    TBattery,
    doc="What a battery holds, and what flows.",
)

_BatteryStatus_getBatteryState: Operation[TBattery] = Operation(
    "RoboCompBatteryStatus::BatteryStatus",
    "getBatteryState",
    outputs=(Field("ret", TBattery.__contract__),),
    raises=(HardwareFailedException.__contract__,),
    doc="What is left now.",
)
BATTERYSTATUS_INTERFACE = Interface(
    "RoboCompBatteryStatus::BatteryStatus",
    (_BatteryStatus_getBatteryState,),
)
