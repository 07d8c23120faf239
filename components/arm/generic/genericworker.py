# Generated from arm.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of arm, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

from robocomp_py.runtime.api import Component, Port, Verb, Worker

from . import RoboCompArm, RoboCompJointMotor
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "arm",
        ports=(
            Port(
                Verb.REQUIRES,
                RoboCompJointMotor.JOINTMOTOR_INTERFACE,
                proxy=RoboCompJointMotor.JointMotorProxy,
            ),
            Port(Verb.IMPLEMENTS, RoboCompArm.ARM_INTERFACE),
        ),
        params=PARAMS,
        period=0.05,
        description="Moves the tool of an arm in a straight line to a pose.",
    )
    middleware = "auto"

    jointmotor_proxy: RoboCompJointMotor.JointMotorProxy

    @abstractmethod
    def Arm_move(self, goal: RoboCompArm.Pose, speed: float) -> None:
        """Move the tool to a pose, and keep it there. A goal that moves ahead, such as
        a thing on a belt that runs along z, has a speed (mm/s) and is told again and
        again.

        IDSL: void move(Pose goal, double speed)
        """

    @abstractmethod
    def Arm_rest(self) -> None:
        """Move all joints to their home positions, however the tool moves meanwhile.

        IDSL: void rest()
        """

    @abstractmethod
    def Arm_isThere(self) -> bool:
        """Whether it is where it was told to go.

        IDSL: idempotent bool isThere()
        """
