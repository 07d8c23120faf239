# Generated from GotoPoint.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompGotoPoint: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import (
    BOOL,
    FLOAT32,
    STRING,
    Field,
    Future,
    Interface,
    Operation,
    Proxy,
)

_GotoPoint_go: Operation[None] = Operation(
    "RoboCompGotoPoint::GotoPoint",
    "go",
    inputs=(
        Field("nodo", STRING),
        Field("x", FLOAT32),
        Field("y", FLOAT32),
        Field("alpha", FLOAT32),
    ),
    doc="Go to a place: its name, which may be empty, its x and y on the floor in mm, and where\nto look there in rad.",  # noqa: E501, RUF100
)
_GotoPoint_turn: Operation[None] = Operation(
    "RoboCompGotoPoint::GotoPoint",
    "turn",
    inputs=(Field("speed", FLOAT32),),
    doc="Turn on the spot: rad/s, positive to the right.",
)
_GotoPoint_stop: Operation[None] = Operation(
    "RoboCompGotoPoint::GotoPoint",
    "stop",
    doc="Stand still.",
)
_GotoPoint_atTarget: Operation[bool] = Operation(
    "RoboCompGotoPoint::GotoPoint",
    "atTarget",
    outputs=(Field("ret", BOOL),),
    doc="Whether the last place to go to was reached.",
)
GOTOPOINT_INTERFACE = Interface(
    "RoboCompGotoPoint::GotoPoint",
    (
        _GotoPoint_go,
        _GotoPoint_turn,
        _GotoPoint_stop,
        _GotoPoint_atTarget,
    ),
)


class GotoPointProxy(Proxy):
    """Calls GotoPoint of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = GOTOPOINT_INTERFACE

    def go(
        self,
        nodo: str,
        x: float,
        y: float,
        alpha: float,
        *,
        deadline: float | None = None,
    ) -> None:
        """Go to a place: its name, which may be empty, its x and y on the floor in mm,
        and where to look there in rad.

        IDSL: void go(string nodo, float x, float y, float alpha)
        """
        return self._ask(_GotoPoint_go, (nodo, x, y, alpha), deadline)

    def goAsync(
        self,
        nodo: str,
        x: float,
        y: float,
        alpha: float,
        *,
        deadline: float | None = None,
    ) -> Future[None]:
        """Call `go` without waiting. The Future is done within the deadline."""
        return self._ask_async(_GotoPoint_go, (nodo, x, y, alpha), deadline)

    def turn(self, speed: float, *, deadline: float | None = None) -> None:
        """Turn on the spot: rad/s, positive to the right.

        IDSL: void turn(float speed)
        """
        return self._ask(_GotoPoint_turn, (speed,), deadline)

    def turnAsync(self, speed: float, *, deadline: float | None = None) -> Future[None]:
        """Call `turn` without waiting. The Future is done within the deadline."""
        return self._ask_async(_GotoPoint_turn, (speed,), deadline)

    def stop(self, *, deadline: float | None = None) -> None:
        """Stand still.

        IDSL: void stop()
        """
        return self._ask(_GotoPoint_stop, (), deadline)

    def stopAsync(self, *, deadline: float | None = None) -> Future[None]:
        """Call `stop` without waiting. The Future is done within the deadline."""
        return self._ask_async(_GotoPoint_stop, (), deadline)

    def atTarget(self, *, deadline: float | None = None) -> bool:
        """Whether the last place to go to was reached.

        IDSL: bool atTarget()
        """
        return self._ask(_GotoPoint_atTarget, (), deadline)

    def atTargetAsync(self, *, deadline: float | None = None) -> Future[bool]:
        """Call `atTarget` without waiting. The Future is done within the deadline."""
        return self._ask_async(_GotoPoint_atTarget, (), deadline)
