# Generated from GenericBase.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompGenericBase: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import (
    BOOL,
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
    """The base itself is at fault: a motor, a cable, its controller."""

    what: str = ""  # what is wrong, for people

    __contract__: ClassVar[ExceptionType]


HardwareFailedException.__contract__ = ExceptionType(
    "RoboCompGenericBase::HardwareFailedException",
    (Field("what", STRING, doc="what is wrong, for people"),),
    base=None,
    python=HardwareFailedException,
    doc="The base itself is at fault: a motor, a cable, its controller.",
)


@dataclass(slots=True)
class TBaseState:
    """Where a base is and how it moves."""

    x: float = 0.0  # mm, by the odometer
    correctedX: float = 0.0  # mm, the best estimate
    z: float = 0.0  # mm, by the odometer
    correctedZ: float = 0.0  # mm, the best estimate
    alpha: float = 0.0  # rad, by the odometer
    correctedAlpha: float = 0.0  # rad, the best estimate
    advVx: float = 0.0  # mm/s sideways, positive to the right; 0 on differential bases
    advVz: float = 0.0  # mm/s, positive forwards
    rotV: float = 0.0  # rad/s, positive to the right
    isMoving: bool = False  # whether any of the three speeds is not 0

    __contract__: ClassVar[Struct]


TBaseState.__contract__ = Struct(
    "RoboCompGenericBase::TBaseState",
    (
        Field("x", FLOAT32, doc="mm, by the odometer"),
        Field("correctedX", FLOAT32, doc="mm, the best estimate"),
        Field("z", FLOAT32, doc="mm, by the odometer"),
        Field("correctedZ", FLOAT32, doc="mm, the best estimate"),
        Field("alpha", FLOAT32, doc="rad, by the odometer"),
        Field("correctedAlpha", FLOAT32, doc="rad, the best estimate"),
        Field(
            "advVx",
            FLOAT32,
            doc="mm/s sideways, positive to the right; 0 on differential bases",
        ),
        Field("advVz", FLOAT32, doc="mm/s, positive forwards"),
        Field("rotV", FLOAT32, doc="rad/s, positive to the right"),
        Field("isMoving", BOOL, doc="whether any of the three speeds is not 0"),
    ),
    TBaseState,
    doc="Where a base is and how it moves.",
)

_GenericBase_getBaseState: Operation[TBaseState] = Operation(
    "RoboCompGenericBase::GenericBase",
    "getBaseState",
    outputs=(Field("state", TBaseState.__contract__),),
    raises=(HardwareFailedException.__contract__,),
    doc="Where the base is and how it moves.",
)
_GenericBase_getBasePose: Operation[tuple[int, int, float]] = Operation(
    "RoboCompGenericBase::GenericBase",
    "getBasePose",
    outputs=(
        Field("x", INT32),
        Field("z", INT32),
        Field("alpha", FLOAT32),
    ),
    raises=(HardwareFailedException.__contract__,),
    doc="Where the base is by its odometer: mm, mm, rad.",
)
GENERICBASE_INTERFACE = Interface(
    "RoboCompGenericBase::GenericBase",
    (
        _GenericBase_getBaseState,
        _GenericBase_getBasePose,
    ),
)
