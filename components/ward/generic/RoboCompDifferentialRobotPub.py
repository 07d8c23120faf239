# Generated from DifferentialRobotPub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompDifferentialRobotPub: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import Field, Interface, Operation, Proxy

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


class DifferentialRobotPubPublisher(Proxy):
    """Publishes DifferentialRobotPub. A call waits only if its QoS is reliable."""

    interface = DIFFERENTIALROBOTPUB_INTERFACE

    def pushBaseState(
        self,
        state: RoboCompGenericBase.TBaseState,
        *,
        deadline: float | None = None,
    ) -> None:
        """Where the base is and how it moves.

        IDSL: void pushBaseState(RoboCompGenericBase::TBaseState state)
        """
        self._send(_DifferentialRobotPub_pushBaseState, (state,), deadline)
