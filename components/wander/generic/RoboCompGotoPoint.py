# Generated from GotoPoint.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompGotoPoint: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import BOOL, FLOAT32, STRING, Field, Interface, Operation

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
