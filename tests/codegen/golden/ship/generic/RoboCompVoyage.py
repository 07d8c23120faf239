# Generated from Voyage.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module RoboCompVoyage: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

from robocomp_py.actions import api as _actions
from robocomp_py.runtime.api import (
    BOOL,
    FLOAT32,
    INT32,
    STRING,
    DeclaredError,
    ExceptionType,
    Field,
    Future,
    Interface,
    Operation,
    Pattern,
    Sequence,
    Struct,
)


@dataclass(slots=True)
class Place:
    """Place of module RoboCompVoyage."""

    x: float = 0.0
    y: float = 0.0

    __contract__: ClassVar[Struct]


Place.__contract__ = Struct(
    "RoboCompVoyage::Place",
    (
        Field("x", FLOAT32),
        Field("y", FLOAT32),
    ),
    Place,
)


@dataclass(slots=True)
class Arrival:
    """Arrival of module RoboCompVoyage."""

    place: Place = field(default_factory=Place)
    steps: int = 0

    __contract__: ClassVar[Struct]


Arrival.__contract__ = Struct(
    "RoboCompVoyage::Arrival",
    (
        Field("place", Place.__contract__),
        Field("steps", INT32),
    ),
    Arrival,
)


@dataclass(eq=False)
class Blocked(DeclaredError):
    """Blocked of module RoboCompVoyage."""

    by: str = ""

    __contract__: ClassVar[ExceptionType]


Blocked.__contract__ = ExceptionType(
    "RoboCompVoyage::Blocked",
    (Field("by", STRING),),
    base=None,
    python=Blocked,
)

Places: TypeAlias = list[Place]


@dataclass(slots=True)
class PilotGoToFeedback:
    """The feedback of `goTo`."""

    left: float = 0.0
    seen: Places = field(default_factory=list)

    __contract__: ClassVar[Struct]


PilotGoToFeedback.__contract__ = Struct(
    "RoboCompVoyage::PilotGoToFeedback",
    (
        Field("left", FLOAT32),
        Field("seen", Sequence(Place.__contract__)),
    ),
    PilotGoToFeedback,
    doc="The feedback of `goTo`.",
)


@dataclass(slots=True)
class CaptainTurnRoundFeedback:
    """The feedback of `turn_round`."""

    deadline: int = 0

    __contract__: ClassVar[Struct]


CaptainTurnRoundFeedback.__contract__ = Struct(
    "RoboCompVoyage::CaptainTurnRoundFeedback",
    (Field("deadline", INT32),),
    CaptainTurnRoundFeedback,
    doc="The feedback of `turn_round`.",
)


class PilotGoToGoal(_actions.ServerGoal):
    """A goal of `goTo`, for its handler."""

    def feedback(self, left: float, seen: Places) -> None:
        """Tell the client how far the goal is. It sees the newest feedback only."""
        self._tell(PilotGoToFeedback(left, seen))


_Pilot_goTo = _actions.Action(
    "RoboCompVoyage::Pilot",
    "goTo",
    inputs=(
        Field("target", Place.__contract__),
        Field("speed", FLOAT32, 0.5),
    ),
    outputs=(Field("ret", Arrival.__contract__),),
    feedback=PilotGoToFeedback.__contract__,
    raises=(Blocked.__contract__,),
    goal=PilotGoToGoal,
    doc="Go to a place.",
)
_Pilot_dock = _actions.Action(
    "RoboCompVoyage::Pilot",
    "dock",
)
_Pilot_battery: Operation[float] = Operation(
    "RoboCompVoyage::Pilot",
    "battery",
    outputs=(Field("ret", FLOAT32),),
    pattern=Pattern.QUERY,
)
PILOT_INTERFACE = Interface(
    "RoboCompVoyage::Pilot",
    (_Pilot_battery,),
    actions=(
        _Pilot_goTo,
        _Pilot_dock,
    ),
)


class CaptainTurnRoundGoal(_actions.ServerGoal):
    """A goal of `turn_round`, for its handler."""

    def feedback(self, deadline: int) -> None:
        """Tell the client how far the goal is. It sees the newest feedback only."""
        self._tell(CaptainTurnRoundFeedback(deadline))


_Captain_goTo = _actions.Action(
    "RoboCompVoyage::Captain",
    "goTo",
    inputs=(
        Field("target", Place.__contract__),
        Field("speed", FLOAT32, 0.5),
    ),
    outputs=(Field("ret", Arrival.__contract__),),
    feedback=PilotGoToFeedback.__contract__,
    raises=(Blocked.__contract__,),
    origin="RoboCompVoyage::Pilot",
    goal=PilotGoToGoal,
    doc="Go to a place.",
)
_Captain_dock = _actions.Action(
    "RoboCompVoyage::Captain",
    "dock",
    origin="RoboCompVoyage::Pilot",
)
_Captain_turn_round = _actions.Action(
    "RoboCompVoyage::Captain",
    "turn_round",
    inputs=(Field("goals", INT32),),
    outputs=(
        Field("ret", BOOL),
        Field("list", FLOAT32),
    ),
    feedback=CaptainTurnRoundFeedback.__contract__,
    goal=CaptainTurnRoundGoal,
)
_Captain_battery: Operation[float] = Operation(
    "RoboCompVoyage::Captain",
    "battery",
    outputs=(Field("ret", FLOAT32),),
    pattern=Pattern.QUERY,
)
CAPTAIN_INTERFACE = Interface(
    "RoboCompVoyage::Captain",
    (_Captain_battery,),
    actions=(
        _Captain_goTo,
        _Captain_dock,
        _Captain_turn_round,
    ),
)


class PilotProxy(_actions.ActionProxy):
    """Calls Pilot of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    Actions return a goal as soon as the server has accepted it.
    """

    interface = PILOT_INTERFACE

    def battery(self, *, deadline: float | None = None) -> float:
        """`battery` of RoboCompVoyage.Pilot.

        IDSL: [query] float battery()
        """
        return self._ask(_Pilot_battery, (), deadline)

    def batteryAsync(self, *, deadline: float | None = None) -> Future[float]:
        """Call `battery` without waiting. The Future is done within the deadline."""
        return self._ask_async(_Pilot_battery, (), deadline)

    def goTo(
        self,
        target: Place,
        speed: float = 0.5,
        *,
        detached: bool = False,
        deadline: float | None = None,
    ) -> _actions.Goal[Arrival, PilotGoToFeedback]:
        """Go to a place.

        IDSL: [action] Arrival goTo(Place target, float speed = 0.5) feedback(float
        left, Places seen) throws Blocked
        """
        return self._begin(_Pilot_goTo, (target, speed), detached, deadline)

    def dock(
        self,
        *,
        detached: bool = False,
        deadline: float | None = None,
    ) -> _actions.Goal[None, None]:
        """`dock` of RoboCompVoyage.Pilot.

        IDSL: [action] void dock()
        """
        return self._begin(_Pilot_dock, (), detached, deadline)


class CaptainProxy(_actions.ActionProxy):
    """Calls Captain of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    Actions return a goal as soon as the server has accepted it.
    """

    interface = CAPTAIN_INTERFACE

    def battery(self, *, deadline: float | None = None) -> float:
        """`battery` of RoboCompVoyage.Captain.

        IDSL: [query] float battery()
        """
        return self._ask(_Captain_battery, (), deadline)

    def batteryAsync(self, *, deadline: float | None = None) -> Future[float]:
        """Call `battery` without waiting. The Future is done within the deadline."""
        return self._ask_async(_Captain_battery, (), deadline)

    def goTo(
        self,
        target: Place,
        speed: float = 0.5,
        *,
        detached: bool = False,
        deadline: float | None = None,
    ) -> _actions.Goal[Arrival, PilotGoToFeedback]:
        """Go to a place.

        IDSL: [action] Arrival goTo(Place target, float speed = 0.5) feedback(float
        left, Places seen) throws Blocked
        """
        return self._begin(_Captain_goTo, (target, speed), detached, deadline)

    def dock(
        self,
        *,
        detached: bool = False,
        deadline: float | None = None,
    ) -> _actions.Goal[None, None]:
        """`dock` of RoboCompVoyage.Captain.

        IDSL: [action] void dock()
        """
        return self._begin(_Captain_dock, (), detached, deadline)

    def turn_round(
        self,
        goals: int,
        *,
        detached: bool = False,
        deadline: float | None = None,
    ) -> _actions.Goal[tuple[bool, float], CaptainTurnRoundFeedback]:
        """`turn_round` of RoboCompVoyage.Captain.

        IDSL: [action] bool turn_round(int goals, out float list) feedback(int deadline)
        """
        return self._begin(_Captain_turn_round, (goals,), detached, deadline)
