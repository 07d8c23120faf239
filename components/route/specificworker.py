"""Drives a base along a route, also sideways, and waits while something is in its way.

It steers by the odometry of the base, and looks at its way by the laser. Lengths are in
m, and angles in rad, positive to the right; messages are in mm, as in RoboComp.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .generic import RoboCompGenericBase, RoboCompLaser
from .generic.genericworker import GenericWorker
from .generic.params import PlacesItem

Floats = NDArray[np.float64]
TBaseState = RoboCompGenericBase.TBaseState

APPROACH = 2.0
"""m/s and rad/s for every m and rad that are left."""

LOOKAHEAD_S = 0.5
"""The way is looked at for this time."""


class SpecificWorker(GenericWorker):
    """Ends when the last place is reached."""

    def initialize(self) -> None:
        """Begin with the first place."""
        self.places = list(self.params.places)
        self.waits = False

    def compute(self) -> None:
        """Drive on, towards the next place."""
        state = self.omnirobot_proxy.getBaseState()
        while self.places and self.is_at(self.places[0], state):
            place = self.places.pop(0)
            self.log.info("at %.1f, %.1f", place.x, place.z)
        if not self.places:
            self.omnirobot_proxy.stopBase()
            self.log.info("at the end of the route")
            self.stop()
            return
        aside, ahead, turn = self.speeds(self.places[0], state)
        waits = not self.is_free(self.laser_proxy.getLaserData(), aside, ahead)
        if waits and not self.waits:
            self.log.info("waiting: something is in the way")
        self.waits = waits
        if waits:
            self.omnirobot_proxy.stopBase()
        else:
            self.omnirobot_proxy.setSpeedBase(aside * 1000, ahead * 1000, turn)

    def is_at(self, place: PlacesItem, state: TBaseState) -> bool:
        away = math.hypot(*offset(place, state))
        return max(away, abs(turn_to(place, state))) < self.params.near

    def speeds(
        self, place: PlacesItem, state: TBaseState
    ) -> tuple[float, float, float]:
        """Towards a place: to the right, ahead, and in turn."""
        aside, ahead = offset(place, state)
        away, turn = math.hypot(aside, ahead), turn_to(place, state) * APPROACH
        factor = min(APPROACH, self.params.speed / max(away, 1e-6))
        fastest = self.params.turning
        return aside * factor, ahead * factor, min(max(turn, -fastest), fastest)

    def is_free(
        self, scan: RoboCompLaser.TLaserData, aside: float, ahead: float
    ) -> bool:
        """Whether the robot can move at this speed for a moment."""
        directions = np.array([each.angle for each in scan])
        distances = np.array([each.dist for each in scan]) / 1000
        right, front = distances * np.sin(directions), distances * np.cos(directions)
        for seconds in (LOOKAHEAD_S / 2, LOOKAHEAD_S):
            then = self.is_inside(right - aside * seconds, front - ahead * seconds)
            if (then & ~self.is_inside(right, front)).any():
                return False  # what is inside now is no reason: it could never leave
        return True

    def is_inside(self, right: Floats, front: Floats) -> NDArray[np.bool_]:
        """Which points the robot covers, with its margin."""
        wide = self.params.wide + self.params.margin
        long = self.params.long + self.params.margin
        inside: NDArray[np.bool_] = (np.abs(right) < wide) & (np.abs(front) < long)
        return inside


def offset(place: PlacesItem, state: TBaseState) -> tuple[float, float]:
    """How far a place is to the right of the robot, and ahead of it."""
    dx, dz = place.x - state.correctedX / 1000, place.z - state.correctedZ / 1000
    sin, cos = math.sin(state.correctedAlpha), math.cos(state.correctedAlpha)
    return dx * cos - dz * sin, dx * sin + dz * cos


def turn_to(place: PlacesItem, state: TBaseState) -> float:
    """The turn to the heading of a place, the shorter way."""
    return math.remainder(place.alpha - state.correctedAlpha, math.tau)
