# Generated from arm.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of arm with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake

from . import RoboCompJointMotor


class JointMotorFakes(TypedDict, total=False):
    """Fakes for the peer of `jointmotor`."""

    setPosition: Fake[None]
    setVelocity: Fake[None]
    setZeroPos: Fake[None]
    setSyncPosition: Fake[None]
    setSyncVelocity: Fake[None]
    setSyncZeroPos: Fake[None]
    getMotorParams: Fake[RoboCompJointMotor.MotorParams]
    getMotorState: Fake[RoboCompJointMotor.MotorState]
    getMotorStateMap: Fake[RoboCompJointMotor.MotorStateMap]
    getAllMotorState: Fake[RoboCompJointMotor.MotorStateMap]
    getAllMotorParams: Fake[RoboCompJointMotor.MotorParamsList]
    getBusParams: Fake[RoboCompJointMotor.BusParams]


class Fakes(TypedDict, total=False):
    """Fakes for the peers of all ports."""

    jointmotor: JointMotorFakes
