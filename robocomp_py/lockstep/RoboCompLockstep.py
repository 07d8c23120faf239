# Generated from Lockstep.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module RoboCompLockstep: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import (
    BOOL,
    INT32,
    INT64,
    STRING,
    Enumeration,
    Field,
    Future,
    Interface,
    Operation,
    Proxy,
    Sequence,
    Struct,
)


class Way(IntEnum):
    """Way of module RoboCompLockstep."""

    Publishes = 0
    Hears = 1
    Sends = 2
    Takes = 3
    Calls = 4
    Serves = 5

    __contract__: ClassVar[Enumeration]


Way.__contract__ = Enumeration(
    "RoboCompLockstep::Way",
    (
        ("Publishes", 0),
        ("Hears", 1),
        ("Sends", 2),
        ("Takes", 3),
        ("Calls", 4),
        ("Serves", 5),
    ),
    Way,
)

ChannelList: TypeAlias = list[str]


@dataclass(slots=True)
class Counter:
    """Something that a component counts."""

    way: Way = Way.Publishes
    # one, unless a subscription hears several publishers
    channels: ChannelList = field(default_factory=list)

    __contract__: ClassVar[Struct]


Counter.__contract__ = Struct(
    "RoboCompLockstep::Counter",
    (
        Field("way", Way.__contract__),
        Field(
            "channels",
            Sequence(STRING),
            doc="one, unless a subscription hears several publishers",
        ),
    ),
    Counter,
    doc="Something that a component counts.",
)

CounterList: TypeAlias = list[Counter]

NumberList: TypeAlias = NDArray[np.int64]


@dataclass(slots=True)
class Report:
    """How a component is at an instant."""

    due: int = 0  # when it has something to do next
    settled: bool = False  # whether all its threads wait
    version: int = 0  # another one when its counters are others, or it was restarted
    # of others that it has made so far: their handlers may have sent something
    calls: int = 0
    # of messages so far, or of calls in progress, in the order of its counters
    numbers: NumberList = field(default_factory=lambda: np.empty(0, np.int64))

    __contract__: ClassVar[Struct]


Report.__contract__ = Struct(
    "RoboCompLockstep::Report",
    (
        Field("due", INT64, doc="when it has something to do next"),
        Field("settled", BOOL, doc="whether all its threads wait"),
        Field(
            "version",
            INT32,
            doc="another one when its counters are others, or it was restarted",
        ),
        Field(
            "calls",
            INT64,
            doc="of others that it has made so far: their handlers may have sent something",  # noqa: E501, RUF100
        ),
        Field(
            "numbers",
            Sequence(INT64),
            doc="of messages so far, or of calls in progress, in the order of its counters",  # noqa: E501, RUF100
        ),
    ),
    Report,
    doc="How a component is at an instant.",
)

_LockstepLeader_join: Operation[None] = Operation(
    "RoboCompLockstep::LockstepLeader",
    "join",
    inputs=(
        Field("instance", STRING),
        Field("now", INT64),
    ),
    doc="Take part from the next instant on. `now` is the time that its clock shows.",
)
_LockstepLeader_hasJoined: Operation[bool] = Operation(
    "RoboCompLockstep::LockstepLeader",
    "hasJoined",
    inputs=(Field("instance", STRING),),
    outputs=(Field("ret", BOOL),),
    idempotent=True,
    doc="Whether this instance takes part.",
)
_LockstepLeader_leave: Operation[None] = Operation(
    "RoboCompLockstep::LockstepLeader",
    "leave",
    inputs=(Field("instance", STRING),),
    doc="Take part no longer.",
)
LOCKSTEPLEADER_INTERFACE = Interface(
    "RoboCompLockstep::LockstepLeader",
    (
        _LockstepLeader_join,
        _LockstepLeader_hasJoined,
        _LockstepLeader_leave,
    ),
)

_LockstepFollower_step: Operation[Report] = Operation(
    "RoboCompLockstep::LockstepFollower",
    "step",
    inputs=(Field("now", INT64),),
    outputs=(Field("ret", Report.__contract__),),
    idempotent=True,
    doc="Do all that is due until this instant. It may come back before that is done.",
)
_LockstepFollower_tell: Operation[Report] = Operation(
    "RoboCompLockstep::LockstepFollower",
    "tell",
    inputs=(Field("now", INT64),),
    outputs=(Field("ret", Report.__contract__),),
    idempotent=True,
    doc="Show this instant to handlers. What is due waits for `step`.",
)
_LockstepFollower_look: Operation[Report] = Operation(
    "RoboCompLockstep::LockstepFollower",
    "look",
    inputs=(Field("last", Report.__contract__),),
    outputs=(Field("ret", Report.__contract__),),
    idempotent=True,
    doc="Wait until its report differs from the last one, but not long.",
)
_LockstepFollower_counters: Operation[CounterList] = Operation(
    "RoboCompLockstep::LockstepFollower",
    "counters",
    outputs=(Field("ret", Sequence(Counter.__contract__)),),
    idempotent=True,
    doc="What the numbers of its reports count. Those without channels are no longer used.",  # noqa: E501, RUF100
)
_LockstepFollower_line: Operation[str] = Operation(
    "RoboCompLockstep::LockstepFollower",
    "line",
    outputs=(Field("ret", STRING),),
    idempotent=True,
    doc="The address of a socket over which the leader asks faster. Empty: the leader asks by queries.",  # noqa: E501, RUF100
)
LOCKSTEPFOLLOWER_INTERFACE = Interface(
    "RoboCompLockstep::LockstepFollower",
    (
        _LockstepFollower_step,
        _LockstepFollower_tell,
        _LockstepFollower_look,
        _LockstepFollower_counters,
        _LockstepFollower_line,
    ),
)


class LockstepLeaderProxy(Proxy):
    """Calls LockstepLeader of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = LOCKSTEPLEADER_INTERFACE

    def join(self, instance: str, now: int, *, deadline: float | None = None) -> None:
        """Take part from the next instant on. `now` is the time that its clock shows.

        IDSL: void join(string instance, int64 now)
        """
        return self._ask(_LockstepLeader_join, (instance, now), deadline)

    def joinAsync(
        self,
        instance: str,
        now: int,
        *,
        deadline: float | None = None,
    ) -> Future[None]:
        """Call `join` without waiting. The Future is done within the deadline."""
        return self._ask_async(_LockstepLeader_join, (instance, now), deadline)

    def hasJoined(self, instance: str, *, deadline: float | None = None) -> bool:
        """Whether this instance takes part.

        IDSL: idempotent bool hasJoined(string instance)
        """
        return self._ask(_LockstepLeader_hasJoined, (instance,), deadline)

    def hasJoinedAsync(
        self,
        instance: str,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `hasJoined` without waiting. The Future is done within the deadline."""
        return self._ask_async(_LockstepLeader_hasJoined, (instance,), deadline)

    def leave(self, instance: str, *, deadline: float | None = None) -> None:
        """Take part no longer.

        IDSL: void leave(string instance)
        """
        return self._ask(_LockstepLeader_leave, (instance,), deadline)

    def leaveAsync(
        self,
        instance: str,
        *,
        deadline: float | None = None,
    ) -> Future[None]:
        """Call `leave` without waiting. The Future is done within the deadline."""
        return self._ask_async(_LockstepLeader_leave, (instance,), deadline)


class LockstepFollowerProxy(Proxy):
    """Calls LockstepFollower of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = LOCKSTEPFOLLOWER_INTERFACE

    def step(self, now: int, *, deadline: float | None = None) -> Report:
        """Do all that is due until this instant. It may come back before that is done.

        IDSL: idempotent Report step(int64 now)
        """
        return self._ask(_LockstepFollower_step, (now,), deadline)

    def stepAsync(self, now: int, *, deadline: float | None = None) -> Future[Report]:
        """Call `step` without waiting. The Future is done within the deadline."""
        return self._ask_async(_LockstepFollower_step, (now,), deadline)

    def tell(self, now: int, *, deadline: float | None = None) -> Report:
        """Show this instant to handlers. What is due waits for `step`.

        IDSL: idempotent Report tell(int64 now)
        """
        return self._ask(_LockstepFollower_tell, (now,), deadline)

    def tellAsync(self, now: int, *, deadline: float | None = None) -> Future[Report]:
        """Call `tell` without waiting. The Future is done within the deadline."""
        return self._ask_async(_LockstepFollower_tell, (now,), deadline)

    def look(self, last: Report, *, deadline: float | None = None) -> Report:
        """Wait until its report differs from the last one, but not long.

        IDSL: idempotent Report look(Report last)
        """
        return self._ask(_LockstepFollower_look, (last,), deadline)

    def lookAsync(
        self,
        last: Report,
        *,
        deadline: float | None = None,
    ) -> Future[Report]:
        """Call `look` without waiting. The Future is done within the deadline."""
        return self._ask_async(_LockstepFollower_look, (last,), deadline)

    def counters(self, *, deadline: float | None = None) -> CounterList:
        """What the numbers of its reports count. Those without channels are no longer
        used.

        IDSL: idempotent CounterList counters()
        """
        return self._ask(_LockstepFollower_counters, (), deadline)

    def countersAsync(self, *, deadline: float | None = None) -> Future[CounterList]:
        """Call `counters` without waiting. The Future is done within the deadline."""
        return self._ask_async(_LockstepFollower_counters, (), deadline)

    def line(self, *, deadline: float | None = None) -> str:
        """The address of a socket over which the leader asks faster. Empty: the leader
        asks by queries.

        IDSL: idempotent string line()
        """
        return self._ask(_LockstepFollower_line, (), deadline)

    def lineAsync(self, *, deadline: float | None = None) -> Future[str]:
        """Call `line` without waiting. The Future is done within the deadline."""
        return self._ask_async(_LockstepFollower_line, (), deadline)
