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
)
_GotoPoint_turn: Operation[None] = Operation(
    "RoboCompGotoPoint::GotoPoint",
    "turn",
    inputs=(Field("speed", FLOAT32),),
)
_GotoPoint_stop: Operation[None] = Operation(
    "RoboCompGotoPoint::GotoPoint",
    "stop",
)
_GotoPoint_atTarget: Operation[bool] = Operation(
    "RoboCompGotoPoint::GotoPoint",
    "atTarget",
    outputs=(Field("ret", BOOL),),
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
