"""Drives a robot around, or to a place, and past whatever is in the way.

rest      stands still: at first, and after `stop`
explore   follows the walls: after a `go` to "anywhere", wherever x, y and alpha point.
          Each time it has the other hand at the wall than the time before, so that two
          explorations from one place come to different parts of the house.
approach  drives to the x, y and alpha of any other `go`, then rests
spin      turns on the spot: after `turn`
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .generic import RoboCompLaser
from .generic.genericworker import GenericWorker
from .steering import RIGHT, TURNING, Course, Scan, along_wall, speeds

ANYWHERE = "anywhere"
ALPHA_TOLERANCE_RAD = 0.1


@dataclass(frozen=True)
class Target:
    """A place to go to, in m, and where to look there, in rad."""

    x: float
    z: float
    alpha: float


class SpecificWorker(GenericWorker):
    """`compute` does what handlers have chosen, and it alone drives: so nothing drives
    on after `stop`, although handlers are let in while it waits for an answer.
    """

    def initialize(self) -> None:
        """Begin as configured."""
        self.scan: Scan | None = None
        self.hand = RIGHT
        self.target = Target(0.0, 0.0, 0.0)
        self.course = Course()
        self.spinning = 0.0
        self.arrived = False
        self.moving = False
        self.doing: Callable[[], None] = self.rest
        if self.params.explores:
            self.GotoPoint_go(ANYWHERE, 0.0, 0.0, 0.0)

    def compute(self) -> None:
        """Do what was chosen last."""
        self.doing()

    def rest(self) -> None:
        """Stop once; then there is nothing more to do."""
        if self.moving:
            self.differentialrobot_proxy.stopBase()
            self.moving = False

    def explore(self) -> None:
        """Every scan is used once. Without new ones the base stops by itself."""
        if self.scan:
            scan, self.scan = self.scan, None
            self.drive(*speeds(along_wall(scan, self.hand), self.params.speed))

    def approach(self) -> None:
        """Drive on towards the target; when there, turn to where to look."""
        scan, state = self.laser_proxy.getLaserAndBStateData()
        if self.doing != self.approach:  # something else was chosen meanwhile
            return
        x, z = state.correctedX / 1000, state.correctedZ / 1000
        dx, dz = self.target.x - x, self.target.z - z
        distance = math.hypot(dx, dz)
        if distance > self.params.near:
            bearing = _turn(state.correctedAlpha, math.atan2(dx, dz))
            way = self.course.way(_scan_of(scan), bearing, distance)
            adv, rot = speeds(way, self.params.speed)
            self.drive(min(adv, distance), rot)
            return
        turn = _turn(state.correctedAlpha, self.target.alpha)
        if abs(turn) > ALPHA_TOLERANCE_RAD:
            self.drive(0.0, TURNING * turn)
        else:
            self.arrived = True
            self.doing = self.rest

    def spin(self) -> None:
        """Say it again and again: the base stops if it hears nothing."""
        self.drive(0.0, self.spinning)

    def drive(self, adv: float, rot: float) -> None:
        """m/s and rad/s."""
        self.moving = True
        self.differentialrobot_proxy.setSpeedBase(adv * 1000, rot)

    def LaserPub_pushLaserData(self, laserData: RoboCompLaser.TLaserData) -> None:
        self.scan = _scan_of(laserData)

    def GotoPoint_go(self, nodo: str, x: float, y: float, alpha: float) -> None:
        """Explore if `nodo` is "anywhere", or else go to that place."""
        self.arrived = False
        if nodo == ANYWHERE:
            self.hand = -self.hand
            self.doing = self.explore
        else:
            self.target = Target(x / 1000, y / 1000, alpha)
            self.course = Course()
            self.doing = self.approach

    def GotoPoint_turn(self, speed: float) -> None:
        self.spinning = speed
        self.doing = self.spin

    def GotoPoint_stop(self) -> None:
        self.doing = self.rest

    def GotoPoint_atTarget(self) -> bool:
        return self.arrived


def _scan_of(measures: RoboCompLaser.TLaserData) -> Scan:
    """A scan in m."""
    directions = np.array([measure.angle for measure in measures])
    distances = np.array([measure.dist for measure in measures]) / 1000
    return Scan(directions, distances)


def _turn(heading: float, wanted: float) -> float:
    """How far to turn from one heading to another, the shorter way."""
    return math.remainder(wanted - heading, math.tau)
