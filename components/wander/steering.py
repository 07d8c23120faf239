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
"""Nothing may come nearer to the robot's middle."""

LOOKAHEAD_M = 0.7
"""A direction is free if so much of the way is."""

WALL_M = 1.3
"""What is nearer than this, on the hand's side, is the wall to follow."""

LEFT, RIGHT = -1, 1
"""Which hand is at the wall."""

DIRECTIONS = np.radians(np.arange(-110, 111, 5))


@dataclass(frozen=True)
class Scan:
    """What the laser saw: as many distances as directions."""

    directions: Floats
    distances: Floats


@dataclass(frozen=True)
class Way:
    """Where to turn, and how much of the way straight ahead is free."""

    direction: float
    ahead_m: float


def along_wall(scan: Scan, hand: int) -> Way:
    """As far towards the hand as there is room; straight ahead while no wall is near it."""
    beside = scan.directions * hand > math.radians(30)
    if scan.distances[beside].min() > WALL_M:
        return _nearest_free(scan, 0.0, hand)
    return _nearest_free(scan, hand * DIRECTIONS[-1], hand)


class Approach:
    """The way to a place: straight, or else along what stands between with a hand at it,
    until the place is nearer than where that began, and the straight way is free.
    """

    def __init__(self) -> None:
        self._hand = LEFT
        self._met_m: float | None = None

    def way(self, scan: Scan, bearing: float, distance: float) -> Way:
        """Where to turn if the place is in that direction and so far away."""
        straight = _straight(scan, bearing, distance)
        if straight and (self._met_m is None or distance < self._met_m):
            self._met_m = None
            return straight
        if self._met_m is None:
            self._met_m = distance - LOOKAHEAD_M / 2
            around = _nearest_free(scan, bearing, LEFT).direction
            self._hand = LEFT if around > bearing else RIGHT
        return along_wall(scan, self._hand)


def speeds(way: Way, fastest: float) -> tuple[float, float]:
    """m/s and rad/s: the slower, the more there is to turn and the less room ahead."""
    straightness = max(0.0, 1 - abs(way.direction))
    room = min(max(way.ahead_m / LOOKAHEAD_M, 0.0), 1.0)
    return fastest * straightness * room, min(max(2.5 * way.direction, -2.0), 2.0)


def free_m(scan: Scan, directions: Floats) -> Floats:
    """How far one can drive in each direction before something comes too near."""
    between = scan.directions[None] - directions[:, None]
    ahead = scan.distances * np.cos(between)
    aside = scan.distances * np.sin(between)
    touches = (ahead > 0) & (np.abs(aside) < CLEARANCE_M)
    margin = np.sqrt(np.maximum(CLEARANCE_M**2 - aside**2, 0.0))
    free: Floats = np.where(touches, ahead - margin, np.inf).min(axis=1)
    return free


def _straight(scan: Scan, bearing: float, distance: float) -> Way | None:
    """Straight to a place; None if something stands in the way."""
    towards, ahead = free_m(scan, np.array([bearing, 0.0]))
    seen = abs(bearing) <= DIRECTIONS[-1]
    if seen and towards < min(distance, LOOKAHEAD_M):
        return None
    return Way(bearing, float(ahead))


def _nearest_free(scan: Scan, wanted: float, hand: int) -> Way:
    """The free direction nearest to the one wanted; if none is, round, away from the hand."""
    ahead = float(free_m(scan, np.zeros(1))[0])
    free = DIRECTIONS[free_m(scan, DIRECTIONS) >= LOOKAHEAD_M]
    if not free.size:
        return Way(-hand * math.pi / 2, 0.0)
    return Way(float(free[np.abs(free - wanted).argmin()]), ahead)
