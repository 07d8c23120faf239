# Generated from JointMotorPub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompJointMotorPub: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import (
    STRING,
    Dictionary,
    Field,
    Interface,
    Operation,
    Proxy,
)

from . import RoboCompJointMotor

_JointMotorPub_motorStates: Operation[None] = Operation(
    "RoboCompJointMotorPub::JointMotorPub",
    "motorStates",
    inputs=(
        Field(
            "mstateMap",
            Dictionary(
                STRING,
                RoboCompJointMotor.MotorState.__contract__,
                "RoboCompJointMotor::MotorStateMap",
            ),
        ),
    ),
    doc="What all motors do now.",
)
JOINTMOTORPUB_INTERFACE = Interface(
    "RoboCompJointMotorPub::JointMotorPub",
    (_JointMotorPub_motorStates,),
)


class JointMotorPubPublisher(Proxy):
    """Publishes JointMotorPub. A call waits only if its QoS is reliable."""

    interface = JOINTMOTORPUB_INTERFACE

    def motorStates(
        self,
        mstateMap: RoboCompJointMotor.MotorStateMap,
        *,
        deadline: float | None = None,
    ) -> None:
        """What all motors do now.

        IDSL: void motorStates(RoboCompJointMotor::MotorStateMap mstateMap)
        """
        self._send(_JointMotorPub_motorStates, (mstateMap,), deadline)
