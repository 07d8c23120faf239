# Generated from Clock.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module RoboCompClock: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

from robocomp_py.runtime.api import (
    BOOL,
    FLOAT64,
    STRING,
    TIME,
    Field,
    Interface,
    Operation,
    Pattern,
    Sequence,
    Struct,
)

InstanceList: TypeAlias = list[str]


@dataclass(slots=True)
class ClockState:
    """How a clock stands."""

    now: int = 0  # since the start of the run
    speed: float = 0.0  # seconds of this clock in one second; 0: as fast as possible
    paused: bool = False
    # the instances that follow it, besides its leader
    followers: InstanceList = field(default_factory=list)

    __contract__: ClassVar[Struct]


ClockState.__contract__ = Struct(
    "RoboCompClock::ClockState",
    (
        Field("now", TIME, doc="since the start of the run"),
        Field(
            "speed",
            FLOAT64,
            doc="seconds of this clock in one second; 0: as fast as possible",
        ),
        Field("paused", BOOL),
        Field(
            "followers",
            Sequence(STRING),
            doc="the instances that follow it, besides its leader",
        ),
    ),
    ClockState,
    doc="How a clock stands.",
)

_Clock_tick: Operation[None] = Operation(
    "RoboCompClock::Clock",
    "tick",
    inputs=(
        Field("now", TIME),
        Field("speed", FLOAT64),
    ),
    pattern=Pattern.PUBLISH,
    doc="seconds of this clock in one second; 0: it stands still",
)
CLOCK_INTERFACE = Interface(
    "RoboCompClock::Clock",
    (_Clock_tick,),
)

_ClockControl_state: Operation[ClockState] = Operation(
    "RoboCompClock::ClockControl",
    "state",
    outputs=(Field("ret", ClockState.__contract__),),
    idempotent=True,
)
_ClockControl_pause: Operation[None] = Operation(
    "RoboCompClock::ClockControl",
    "pause",
    idempotent=True,
    doc="Stand still after the present instant.",
)
_ClockControl_resume: Operation[None] = Operation(
    "RoboCompClock::ClockControl",
    "resume",
    idempotent=True,
    doc="Go on at the speed that was set.",
)
_ClockControl_step: Operation[int] = Operation(
    "RoboCompClock::ClockControl",
    "step",
    inputs=(Field("seconds", FLOAT64),),
    outputs=(Field("ret", TIME),),
    doc="Let this time pass, and then stand still. Returns the time at which the clock will stop. In lock-step they pass as\nfast as possible, otherwise at the speed.",  # noqa: E501, RUF100
)
_ClockControl_setSpeed: Operation[None] = Operation(
    "RoboCompClock::ClockControl",
    "setSpeed",
    inputs=(Field("speed", FLOAT64),),
    idempotent=True,
    doc="Seconds of this clock in one second; 0: as fast as possible.",
)
CLOCKCONTROL_INTERFACE = Interface(
    "RoboCompClock::ClockControl",
    (
        _ClockControl_state,
        _ClockControl_pause,
        _ClockControl_resume,
        _ClockControl_step,
        _ClockControl_setSpeed,
    ),
)
