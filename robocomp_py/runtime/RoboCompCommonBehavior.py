# Generated from CommonBehavior.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module RoboCompCommonBehavior: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar, TypeAlias

from robocomp_py.runtime.api import (
    BOOL,
    FLOAT64,
    INT32,
    INT64,
    STRING,
    Dictionary,
    Enumeration,
    Field,
    Interface,
    Operation,
    Sequence,
    Struct,
)


class State(IntEnum):
    """Where a component is in its life."""

    Starting = 0
    Running = 1

    __contract__: ClassVar[Enumeration]


State.__contract__ = Enumeration(
    "RoboCompCommonBehavior::State",
    (
        ("Starting", 0),
        ("Running", 1),
    ),
    State,
)


@dataclass(slots=True)
class Parameter:
    """One configured parameter, as text."""

    editable: bool = False  # whether it can be changed while the component runs
    value: str = ""
    type: str = ""

    __contract__: ClassVar[Struct]


Parameter.__contract__ = Struct(
    "RoboCompCommonBehavior::Parameter",
    (
        Field(
            "editable",
            BOOL,
            doc="whether it can be changed while the component runs",
        ),
        Field("value", STRING),
        Field("type", STRING),
    ),
    Parameter,
    doc="One configured parameter, as text.",
)

ParameterList: TypeAlias = dict[str, Parameter]

StateList: TypeAlias = list[str]

PeerList: TypeAlias = list[str]


@dataclass(slots=True)
class PortStatus:
    """One port of a component, and what it knows of the other end."""

    name: str = ""  # as the CDSL has it
    verb: str = ""  # requires, implements, publishes or subscribesTo
    type: str = ""  # the interface
    middleware: str = ""  # what carries its messages; several are separated by commas
    # the instances that it calls or hears, as far as they are known
    peers: PeerList = field(default_factory=list)
    connected: bool = False  # whether another end of each operation is visible
    missed: int = 0  # deadlines of the QoS that were missed
    lost: int = 0  # how often a publisher was lost, by the lease of the QoS

    __contract__: ClassVar[Struct]


PortStatus.__contract__ = Struct(
    "RoboCompCommonBehavior::PortStatus",
    (
        Field("name", STRING, doc="as the CDSL has it"),
        Field("verb", STRING, doc="requires, implements, publishes or subscribesTo"),
        Field("type", STRING, doc="the interface"),
        Field(
            "middleware",
            STRING,
            doc="what carries its messages; several are separated by commas",
        ),
        Field(
            "peers",
            Sequence(STRING),
            doc="the instances that it calls or hears, as far as they are known",
        ),
        Field(
            "connected",
            BOOL,
            doc="whether another end of each operation is visible",
        ),
        Field("missed", INT64, doc="deadlines of the QoS that were missed"),
        Field(
            "lost",
            INT64,
            doc="how often a publisher was lost, by the lease of the QoS",
        ),
    ),
    PortStatus,
    doc="One port of a component, and what it knows of the other end.",
)

PortStatusList: TypeAlias = list[PortStatus]


@dataclass(slots=True)
class TimerStatus:
    """TimerStatus of module RoboCompCommonBehavior."""

    name: str = ""  # as the CDSL has it
    period: float = 0.0  # in s
    calls: int = 0  # how often its method was called
    overruns: int = 0  # periods that were left out, since a call took longer than one

    __contract__: ClassVar[Struct]


TimerStatus.__contract__ = Struct(
    "RoboCompCommonBehavior::TimerStatus",
    (
        Field("name", STRING, doc="as the CDSL has it"),
        Field("period", FLOAT64, doc="in s"),
        Field("calls", INT64, doc="how often its method was called"),
        Field(
            "overruns",
            INT64,
            doc="periods that were left out, since a call took longer than one",
        ),
    ),
    TimerStatus,
)

TimerStatusList: TypeAlias = list[TimerStatus]


@dataclass(slots=True)
class Status:
    """How a component is."""

    instance: str = ""
    component: str = ""
    version: str = ""  # of robocomp_py
    # starting, initialize, compute, emergency, restore, finish or ended
    state: str = ""
    computes: int = 0  # how often compute was called
    # periods that were left out, since what was done took longer than one
    overruns: int = 0
    missed: int = 0  # deadlines missed at all ports
    lost: int = 0  # publishers lost at all ports
    ports: PortStatusList = field(default_factory=list)
    timers: TimerStatusList = field(default_factory=list)

    __contract__: ClassVar[Struct]


Status.__contract__ = Struct(
    "RoboCompCommonBehavior::Status",
    (
        Field("instance", STRING),
        Field("component", STRING),
        Field("version", STRING, doc="of robocomp_py"),
        Field(
            "state",
            STRING,
            doc="starting, initialize, compute, emergency, restore, finish or ended",
        ),
        Field("computes", INT64, doc="how often compute was called"),
        Field(
            "overruns",
            INT64,
            doc="periods that were left out, since what was done took longer than one",
        ),
        Field("missed", INT64, doc="deadlines missed at all ports"),
        Field("lost", INT64, doc="publishers lost at all ports"),
        Field("ports", Sequence(PortStatus.__contract__)),
        Field("timers", Sequence(TimerStatus.__contract__)),
    ),
    Status,
    doc="How a component is.",
)

_CommonBehavior_getPeriod: Operation[int] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "getPeriod",
    outputs=(Field("ret", INT32),),
    idempotent=True,
    doc="Time from one compute to the next, in ms.",
)
_CommonBehavior_setPeriod: Operation[None] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "setPeriod",
    inputs=(Field("period", INT32),),
    doc="Change the time from one compute to the next, in ms.",
)
_CommonBehavior_timeAwake: Operation[int] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "timeAwake",
    outputs=(Field("ret", INT32),),
    idempotent=True,
    doc="Time since the component was started, in ms.",
)
_CommonBehavior_killYourSelf: Operation[None] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "killYourSelf",
    confirm=True,
    doc="End the component.",
)
_CommonBehavior_getParameterList: Operation[ParameterList] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "getParameterList",
    outputs=(
        Field(
            "ret",
            Dictionary(
                STRING,
                Parameter.__contract__,
                "RoboCompCommonBehavior::ParameterList",
            ),
        ),
    ),
    doc="The configured parameters, by names such as `max_speed` and `motors[0].max_speed`.",  # noqa: E501, RUF100
)
_CommonBehavior_setParameterList: Operation[None] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "setParameterList",
    inputs=(
        Field(
            "l",
            Dictionary(
                STRING,
                Parameter.__contract__,
                "RoboCompCommonBehavior::ParameterList",
            ),
        ),
    ),
    doc="Change dynamic parameters, by name and value: all of them, or none if one is not dynamic or not allowed.",  # noqa: E501, RUF100
)
_CommonBehavior_reloadConfig: Operation[None] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "reloadConfig",
    doc="Load the configuration again; refused, since a component keeps what it started with.",  # noqa: E501, RUF100
)
_CommonBehavior_getState: Operation[State] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "getState",
    outputs=(Field("ret", State.__contract__),),
    doc="Where the component is in its life.",
)
_CommonBehavior_getActiveStates: Operation[StateList] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "getActiveStates",
    outputs=(Field("ret", Sequence(STRING)),),
    idempotent=True,
    doc="The states that its state machine is in, each before those inside of it; none if it has no machine.",  # noqa: E501, RUF100
)
_CommonBehavior_getStatus: Operation[Status] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "getStatus",
    outputs=(Field("ret", Status.__contract__),),
    idempotent=True,
    doc="How the component is, with its ports and their peers. RoboComp's own components lack this operation.",  # noqa: E501, RUF100
)
COMMONBEHAVIOR_INTERFACE = Interface(
    "RoboCompCommonBehavior::CommonBehavior",
    (
        _CommonBehavior_getPeriod,
        _CommonBehavior_setPeriod,
        _CommonBehavior_timeAwake,
        _CommonBehavior_killYourSelf,
        _CommonBehavior_getParameterList,
        _CommonBehavior_setParameterList,
        _CommonBehavior_reloadConfig,
        _CommonBehavior_getState,
        _CommonBehavior_getActiveStates,
        _CommonBehavior_getStatus,
    ),
)
