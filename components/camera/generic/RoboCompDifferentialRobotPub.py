# Generated from DifferentialRobotPub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompDifferentialRobotPub: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import Field, Interface, Operation

from . import RoboCompGenericBase

_DifferentialRobotPub_pushBaseState: Operation[None] = Operation(
    "RoboCompDifferentialRobotPub::DifferentialRobotPub",
    "pushBaseState",
    inputs=(Field("state", RoboCompGenericBase.TBaseState.__contract__),),
    doc="Where the base is and how it moves.",
)
DIFFERENTIALROBOTPUB_INTERFACE = Interface(
    "RoboCompDifferentialRobotPub::DifferentialRobotPub",
    (_DifferentialRobotPub_pushBaseState,),
)
