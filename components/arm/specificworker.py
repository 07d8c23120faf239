"""Moves the tool of an arm in a straight line to a pose, and follows one that moves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from robocomp_py.errors import ConfigurationError
from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree

from .generic import RoboCompArm
from .generic.genericworker import GenericWorker
from .generic.RoboCompJointMotor import MotorGoalVelocity
from .kinematics import Arm, Way, pose

NEAR_MM, NEAR_RAD = 3.0, 0.03


class SpecificWorker(GenericWorker):
    """The arm rests until it gets a goal."""

    def initialize(self) -> None:
        """Read how the arm is built."""
        self.joints: list[str] = []
        scene = Path(__file__).parent / self.params.scene
        try:
            self.arm = Arm(Tree.read(scene), self.params.tool)
        except InnerModelError as exc:
            text = f"{exc}; the parameters `scene` and `tool` say which arm it is"
            raise ConfigurationError(text) from exc
        self.joints = self.arm.joints
        self.goal: RoboCompArm.Pose | None = None
        self.speed = 0.0
        self.told = 0
        self.there = False

    def compute(self) -> None:
        """Let the joints move as the way to the goal needs."""
        states = self.jointmotor_proxy.getMotorStateMap(self.joints)
        positions = {name: state.pos for name, state in states.items()}
        if self.goal:
            way = self.way(positions, self.goal)
        else:
            way = self.arm.way_home(positions)
        self.there = way.distance < NEAR_MM and way.turn < NEAR_RAD
        self.drive(way.speeds.tolist())

    def way(self, positions: Mapping[str, float], goal: RoboCompArm.Pose) -> Way:
        """To a goal that has moved on since it was told."""
        z = goal.z + self.speed * (self.now() - self.told) / 1e9
        return self.arm.way(
            positions,
            pose((goal.x, goal.y, z), (goal.rx, goal.ry, goal.rz)),
            np.array((0.0, 0.0, self.speed)),
            (self.params.speed, self.params.turning),
        )

    def finish(self) -> None:
        """Stop the joints: without new speeds, they would go on."""
        if self.joints:
            self.drive([0.0] * len(self.joints))

    def drive(self, speeds: list[float]) -> None:
        """Set the speeds of all joints, rad/s."""
        self.jointmotor_proxy.setSyncVelocity(
            [
                MotorGoalVelocity(name, speed, 0.0)
                for name, speed in zip(self.joints, speeds, strict=True)
            ]
        )

    def Arm_move(self, goal: RoboCompArm.Pose, speed: float) -> None:
        """A goal that is not finite is refused with ValueError."""
        numbers = (goal.x, goal.y, goal.z, goal.rx, goal.ry, goal.rz, speed)
        if not all(map(math.isfinite, numbers)):
            raise ValueError(f"the goal must be finite, not {numbers}")
        self.goal, self.speed, self.told, self.there = goal, speed, self.now(), False

    def Arm_rest(self) -> None:
        self.goal, self.there = None, False

    def Arm_isThere(self) -> bool:
        return self.there
