# Generated from CommonBehavior.idsl by rcgen 0.1.0: edits are lost.
"""Module RoboCompCommonBehavior: what travels, and how to send it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, TypeAlias

from robocomp_py.runtime.api import (
    BOOL,
    INT32,
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
        Field("editable", BOOL),
        Field("value", STRING),
        Field("type", STRING),
    ),
    Parameter,
)

ParameterList: TypeAlias = dict[str, Parameter]

StateList: TypeAlias = list[str]

_CommonBehavior_getPeriod: Operation[int] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "getPeriod",
    outputs=(Field("ret", INT32),),
    idempotent=True,
)
_CommonBehavior_setPeriod: Operation[None] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "setPeriod",
    inputs=(Field("period", INT32),),
)
_CommonBehavior_timeAwake: Operation[int] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "timeAwake",
    outputs=(Field("ret", INT32),),
    idempotent=True,
)
_CommonBehavior_killYourSelf: Operation[None] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "killYourSelf",
)
_CommonBehavior_getParameterList: Operation[ParameterList] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "getParameterList",
    outputs=(
        Field(
            "ret",
            Dictionary(STRING, Parameter.__contract__, "RoboCompCommonBehavior::ParameterList"),  # noqa: E501
        ),
    ),
)
_CommonBehavior_setParameterList: Operation[None] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "setParameterList",
    inputs=(
        Field(
            "l",
            Dictionary(STRING, Parameter.__contract__, "RoboCompCommonBehavior::ParameterList"),  # noqa: E501
        ),
    ),
)
_CommonBehavior_reloadConfig: Operation[None] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "reloadConfig",
)
_CommonBehavior_getState: Operation[State] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "getState",
    outputs=(Field("ret", State.__contract__),),
)
_CommonBehavior_getActiveStates: Operation[StateList] = Operation(
    "RoboCompCommonBehavior::CommonBehavior",
    "getActiveStates",
    outputs=(Field("ret", Sequence(STRING)),),
    idempotent=True,
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
    ),
)
