"""Drives a robot around, or to a place, and avoids obstacles.

rest      stands still: at first, and after `stop`
explore   follows the walls: after a `go` to "anywhere", which ignores x, y and alpha.
          It follows the left and the right wall in turn, so that two explorations from
          one place reach different parts of the house.
approach  drives to the x, y and alpha of any other `go`, then rests
spin      turns on the spot: after `turn`
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .generic import RoboCompGenericBase, RoboCompLaser
from .generic.genericworker import GenericWorker
from .steering import RIGHT, TURNING, Course, Scan, along_wall, speeds

HardwareFailedException = RoboCompGenericBase.HardwareFailedException

ANYWHERE = "anywhere"
ALPHA_TOLERANCE_RAD = 0.1


@dataclass(frozen=True)
class Target:
    """A place to go to, in m, and the heading there, in rad."""

    x: float
    z: float
    alpha: float


class SpecificWorker(GenericWorker):
    """Handlers choose a mode, and only `compute` drives. So the robot never drives on
    after `stop`, although handlers may run while `compute` waits for a reply.
    """

    def initialize(self) -> None:
        """Explore or rest, as configured."""
        self.scan: Scan | None = None
        self.hand = RIGHT
        self.target = Target(0.0, 0.0, 0.0)
        self.course = Course()
        self.spinning = 0.0
        self.arrived = False
        self.moving = False
        self.base_fails = False
        self.doing: Callable[[], None] = self.rest
        if self.params.explores:
            self.GotoPoint_go(ANYWHERE, 0.0, 0.0, 0.0)

    def compute(self) -> None:
        """Run the mode that was chosen last. If its base fails, stop and try again."""
        try:
            self.doing()
        except HardwareFailedException as failed:
            if not self.base_fails:
                self.log.error("the base fails: %s", failed)
            self.base_fails = True
            with contextlib.suppress(HardwareFailedException):  # which is known
                self.differentialrobot_proxy.stopBase()

    def rest(self) -> None:
        """Stop the base once."""
        if self.moving:
            self.differentialrobot_proxy.stopBase()
            self.moving = False

    def wait(self, missing: str) -> None:
        """Stop the base until the next scan or pose, because one has no data."""
        if self.moving:
            self.log.warning("the robot waits: %s", missing)
        self.rest()

    def explore(self) -> None:
        """Use every scan once. Without new scans the base stops by itself."""
        if self.scan is None:
            return
        scan, self.scan = self.scan, None
        if scan.is_blind:
            self.wait("the laser measures nothing")
        else:
            self.drive(*speeds(along_wall(scan, self.hand), self.params.speed))

    def approach(self) -> None:
        """Drive towards the target; when there, turn to its heading."""
        measures, state = self.laser_proxy.getLaserAndBStateData()
        if self.doing != self.approach:  # a handler has chosen another mode meanwhile
            return
        x, z = state.correctedX / 1000, state.correctedZ / 1000
        if not are_finite(x, z, state.correctedAlpha):
            self.wait("the pose of the robot is unknown")
            return
        dx, dz = self.target.x - x, self.target.z - z
        distance = math.hypot(dx, dz)
        if distance > self.params.near:
            scan = _scan_of(measures)
            if scan.is_blind:
                self.wait("the laser measures nothing")
                return
            bearing = _turn(state.correctedAlpha, math.atan2(dx, dz))
            way = self.course.way(scan, bearing, distance)
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
        """Repeat the command, because the base stops without new ones."""
        self.drive(0.0, self.spinning)

    def drive(self, adv: float, rot: float) -> None:
        """Set the speeds of the base, in m/s and rad/s."""
        self.moving = True
        self.differentialrobot_proxy.setSpeedBase(adv * 1000, rot)
        if self.base_fails:
            self.log.info("the base drives again")
            self.base_fails = False

    def LaserPub_pushLaserData(self, laserData: RoboCompLaser.TLaserData) -> None:
        self.scan = _scan_of(laserData)

    def GotoPoint_go(self, nodo: str, x: float, y: float, alpha: float) -> None:
        """Explore if `nodo` is "anywhere", or else go to that place.

        A place that is not finite is refused with ValueError.
        """
        if nodo != ANYWHERE and not are_finite(x, y, alpha):
            raise ValueError(f"the place must be finite, not {x:g}, {y:g}, {alpha:g}")
        self.arrived = False
        if nodo == ANYWHERE:
            self.hand = -self.hand
            self.doing = self.explore
        else:
            self.target = Target(x / 1000, y / 1000, alpha)
            self.course = Course()
            self.doing = self.approach

    def GotoPoint_turn(self, speed: float) -> None:
        """Turn at this speed. One that is not finite is refused with ValueError."""
        if not are_finite(speed):
            raise ValueError(f"the speed must be finite, not {speed:g}")
        self.spinning = speed
        self.doing = self.spin

    def GotoPoint_stop(self) -> None:
        self.doing = self.rest

    def GotoPoint_atTarget(self) -> bool:
        return self.arrived


def are_finite(*numbers: float) -> bool:
    return all(map(math.isfinite, numbers))


def _scan_of(measures: RoboCompLaser.TLaserData) -> Scan:
    """A scan in m, without measures that are not finite."""
    usable = [each for each in measures if are_finite(each.angle, each.dist)]
    directions = np.array([each.angle for each in usable])
    distances = np.array([each.dist for each in usable]) / 1000
    return Scan(directions, distances)


def _turn(heading: float, wanted: float) -> float:
    """The angle from one heading to another, the shorter way."""
    return math.remainder(wanted - heading, math.tau)
