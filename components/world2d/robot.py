"""The robot: a base that follows commands, and a battery that is drained by driving.

Units are m, rad and s, with the headings of `room`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .room import Point, Room

RADIUS_M = 0.22

FARTHEST_M = 1e6
"""Poses are at most this far from 0: in mm they fit into 32 bits."""

COMMAND_LASTS_S = 1.0
"""Without a new command, the base stops after this time: its client may be gone."""


@dataclass(frozen=True, slots=True)
class Pose:
    x: float
    z: float
    heading: float

    @property
    def place(self) -> Point:
        return self.x, self.z

    @property
    def is_possible(self) -> bool:
        """False if a number is not finite, or the place is too far away."""
        near = abs(self.x) <= FARTHEST_M and abs(self.z) <= FARTHEST_M
        return near and math.isfinite(self.heading)

    def ahead(self, distance: float, aside: float = 0.0) -> Point:
        """The place at this distance, in a direction relative to the heading."""
        heading = self.heading + aside
        return (
            self.x + distance * math.sin(heading),
            self.z + distance * math.cos(heading),
        )

    def moved(self, distance: float, turn: float) -> Pose:
        """The pose after a curve: half the turn, the way, the other half."""
        x, z = self.ahead(distance, turn / 2)
        return Pose(x, z, math.remainder(self.heading + turn, math.tau))


class Base:
    """A disc with two wheels. It stops at obstacles, and never overlaps them.

    `pose` is the true pose; `odometer` and `best` are estimates.
    """

    def __init__(self, room: Room, max_adv: float, max_rot: float) -> None:
        self.pose = self.odometer = self.best = Pose(*room.start)
        self.adv = self.rot = 0.0
        self._room = room
        self._max_adv, self._max_rot = max_adv, max_rot
        self._age = 0.0

    @property
    def moving(self) -> bool:
        return bool(self.adv or self.rot)

    def command(self, adv: float, rot: float) -> None:
        """Drive with these speeds, limited to the fastest possible ones.

        Raises ValueError if one is not finite; then the last command remains.
        """
        if not (math.isfinite(adv) and math.isfinite(rot)):
            raise ValueError("speeds must be finite")
        self.adv = min(max(adv, -self._max_adv), self._max_adv)
        self.rot = min(max(rot, -self._max_rot), self._max_rot)
        self._age = 0.0

    def step(self, seconds: float) -> tuple[float, float]:
        """Let these seconds pass. Returns the driven distance and the turned angle."""
        if self._age >= COMMAND_LASTS_S:
            self.adv = self.rot = 0.0
        self._age += seconds
        turn = self.rot * seconds
        way = self._free(self.adv * seconds, turn)
        self.pose = self.pose.moved(way, turn)
        self.odometer = self.odometer.moved(way, turn)
        self.best = self.best.moved(way, turn)
        return abs(way), abs(turn)

    def _free(self, wanted: float, turn: float) -> float:
        """The free part of a way, checked in pieces too short to skip an obstacle."""
        pieces = math.ceil(abs(wanted) / (RADIUS_M / 2))
        free = 0.0
        for piece in range(1, pieces + 1):
            further = wanted * piece / pieces
            if not self._fits(further, turn):
                return self._contact(free, further, turn)
            free = further
        return free

    def _contact(self, free: float, blocked: float, turn: float) -> float:
        """The way to the contact, to a thousandth of a piece."""
        for _ in range(10):
            middle = (free + blocked) / 2
            if self._fits(middle, turn):
                free = middle
            else:
                blocked = middle
        return free

    def _fits(self, way: float, turn: float) -> bool:
        return self._room.clearance(self.pose.ahead(way, turn / 2)) >= RADIUS_M


@dataclass(slots=True)
class Battery:
    """The charge in %. Driving and turning drain it more than standing still."""

    percent: float
    capacity_wh: float = 1.0
    rate: float = 0.0
    """%/s of late, positive when charging."""
    charging: bool = False

    def step(
        self, seconds: float, driven: float, turned: float, *, charging: bool
    ) -> None:
        """Subtract the cost of these seconds, m and rad; add the gain of charging."""
        before = self.percent
        used = AWAKE * seconds + DRIVING * driven + TURNING * turned
        gained = CHARGING * seconds if charging else 0.0
        change = (gained - used) / self.capacity_wh
        self.percent = min(max(before + change, 0.0), 100.0)
        self.rate = (self.percent - before) / seconds
        self.charging = charging

    @property
    def empty(self) -> bool:
        return self.percent <= 0

    @property
    def full(self) -> bool:
        return self.percent >= 100

    @property
    def voltage(self) -> float:
        """In V; it falls slightly as the battery empties."""
        return 22.0 + 0.04 * self.percent

    @property
    def power(self) -> float:
        """The power that flows into it, in W."""
        return self.rate / 100 * self.capacity_wh * 3600

    @property
    def seconds_to_go(self) -> float:
        """The time until it is full or empty at the recent rate; 0 if nothing flows."""
        if not self.rate:
            return 0.0
        return ((100 if self.rate > 0 else 0) - self.percent) / self.rate


# Of a battery of 1 Wh.
AWAKE = 0.02  # %/s
DRIVING = 2.2  # %/m
TURNING = 0.3  # %/rad
CHARGING = 10.0  # %/s
