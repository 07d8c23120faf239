"""Which way to drive, from one scan of the laser.

Directions are in rad from straight ahead, positive to the right; distances in m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

CLEARANCE_M = 0.40
"""The least distance of obstacles from the robot's centre."""

LOOKAHEAD_M = 0.9
"""A direction is free if this much of the way is free."""

WALL_M = 1.4
"""A thing nearer than this, on the side of the hand, is the wall to follow."""

ASTRAY_RAD = 0.8
"""Driving this far off the direction of a place does not bring it nearer."""

TURN_RAD = 1.4
"""If it must turn by more, the robot turns on the spot."""

TURNING = 2.5
"""rad/s for every rad to turn."""

LEFT, RIGHT = -1, 1
"""The side of the wall that is followed."""

DIRECTIONS = np.radians(np.arange(-110, 111, 5))


@dataclass(frozen=True)
class Scan:
    """A scan of the laser: a distance for each direction."""

    directions: Floats
    distances: Floats

    @property
    def is_blind(self) -> bool:
        """Whether it has no measure at all."""
        return not self.distances.size


@dataclass(frozen=True)
class Way:
    """The angle to turn, and how much of the way straight ahead is free."""

    direction: float
    ahead_m: float


def along_wall(scan: Scan, hand: int) -> Way:
    """The way past the nearest thing on that side; straight on if nothing is near."""
    beside = scan.directions * hand > -math.radians(20)
    if scan.distances[beside].min(initial=math.inf) > WALL_M:
        return _nearest_free(scan, DIRECTIONS, 0.0, hand)
    nearest = scan.distances[beside].argmin()
    wall = scan.directions[beside][nearest]
    return _nearest_free(scan, DIRECTIONS[DIRECTIONS * hand <= wall * hand], wall, hand)


class Course:
    """The way to a place: straight, or closely past an obstacle. If that is not enough,
    along the obstacle as along a wall, until the place is nearer and in sight.
    """

    def __init__(self) -> None:
        self._hand = LEFT
        self._met_m: float | None = None

    def way(self, scan: Scan, bearing: float, distance: float) -> Way:
        """The way to a place in this direction and at this distance."""
        straight = _straight(scan, bearing, distance)
        if self._met_m is not None:
            if not straight or distance > self._met_m:
                return along_wall(scan, self._hand)
            self._met_m = None
        if abs(bearing) > ASTRAY_RAD:
            return Way(bearing, 0.0)
        if straight:
            return straight
        beside = _nearest_free(scan, DIRECTIONS, bearing, LEFT)
        if abs(beside.direction - bearing) < ASTRAY_RAD:
            return beside
        self._hand = LEFT if beside.direction > bearing else RIGHT
        self._met_m = distance - LOOKAHEAD_M / 2
        return along_wall(scan, self._hand)


def speeds(way: Way, fastest: float) -> tuple[float, float]:
    """Speeds in m/s and rad/s: slower for larger turns and for less room ahead."""
    straightness = max(0.0, 1 - abs(way.direction) / TURN_RAD)
    room = min(max(way.ahead_m / LOOKAHEAD_M, 0.0), 1.0)
    return fastest * straightness * room, TURNING * way.direction


def free_m(scan: Scan, directions: Floats) -> Floats:
    """How far the robot can drive in each direction before something is too near."""
    between = scan.directions[None] - directions[:, None]
    ahead = scan.distances * np.cos(between)
    aside = scan.distances * np.sin(between)
    touches = (ahead > 0) & (np.abs(aside) < CLEARANCE_M)
    margin = np.sqrt(np.maximum(CLEARANCE_M**2 - aside**2, 0.0))
    free: Floats = np.where(touches, ahead - margin, np.inf).min(axis=1)
    return free


def _straight(scan: Scan, bearing: float, distance: float) -> Way | None:
    """The straight way to a place; None if something is in the way."""
    towards, ahead = free_m(scan, np.array([bearing, 0.0]))
    seen = abs(bearing) <= DIRECTIONS[-1]
    if seen and towards < min(distance, LOOKAHEAD_M):
        return None
    return Way(bearing, float(ahead))


def _nearest_free(scan: Scan, among: Floats, wanted: float, hand: int) -> Way:
    """The free direction nearest to the wanted one; without any, away from the hand."""
    free = among[free_m(scan, among) >= LOOKAHEAD_M]
    if not free.size:
        return Way(-hand * math.pi / 2, 0.0)
    ahead = float(free_m(scan, np.zeros(1))[0])
    return Way(float(free[np.abs(free - wanted).argmin()]), ahead)
