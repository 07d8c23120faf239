"""The robot: a base that drives as it is told while it can, and a battery that pays for it.

All in m, rad and s, with the headings of `room`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .room import Room

RADIUS_M = 0.22
COMMAND_LASTS_S = 1.0
"""After so long without a new command the base stops: whoever drove it may be gone."""


@dataclass(frozen=True, slots=True)
class Pose:
    x: float
    z: float
    heading: float

    def moved(self, forward_m: float, turn_rad: float) -> Pose:
        """After driving and turning at once: along the heading half way through the turn."""
        x, z = self.ahead(forward_m, turn_rad / 2)
        return Pose(x, z, normalized(self.heading + turn_rad))

    def ahead(self, forward_m: float, aside_rad: float = 0.0) -> tuple[float, float]:
        """The place so far away in that direction."""
        heading = self.heading + aside_rad
        return (
            self.x + forward_m * math.sin(heading),
            self.z + forward_m * math.cos(heading),
        )


def normalized(angle: float) -> float:
    """The same direction between -pi and pi."""
    return math.remainder(angle, math.tau)


class Base:
    """A disc with two wheels. It stops at what is in its way, and never gets into it.

    `odometer` and `best` are where it believes to be; `pose` is where it is.
    """

    def __init__(self, room: Room, max_adv: float, max_rot: float) -> None:
        self.pose = self.odometer = self.best = Pose(*room.start)
        self.adv = self.rot = 0.0
        self.bumped = False
        self.driven_m = 0.0
        self._room = room
        self._max_adv, self._max_rot = max_adv, max_rot
        self._age_s = 0.0

    def command(self, adv: float, rot: float) -> None:
        """Drive with these speeds, as far as it can."""
        self.adv = min(max(adv, -self._max_adv), self._max_adv)
        self.rot = min(max(rot, -self._max_rot), self._max_rot)
        self._age_s = 0.0

    def step(self, seconds: float) -> None:
        """What happens in so many seconds."""
        self._age_s += seconds
        if self._age_s > COMMAND_LASTS_S:
            self.adv = self.rot = 0.0
        wanted, turn = self.adv * seconds, self.rot * seconds
        forward = self._free(wanted, turn)
        self.bumped = forward != wanted
        self.driven_m += abs(forward)
        self.pose = self.pose.moved(forward, turn)
        self.odometer = self.odometer.moved(forward, turn)
        self.best = self.best.moved(forward, turn)

    def _free(self, wanted: float, turn: float) -> float:
        """How much of a way is free: tried in pieces too short to jump over anything."""
        pieces = math.ceil(abs(wanted) / (RADIUS_M / 2))
        done = 0.0
        for piece in range(1, pieces + 1):
            target = wanted * piece / pieces
            if not self._fits(target, turn):
                return self._contact(done, target, turn)
            done = target
        return done

    def _contact(self, free: float, blocked: float, turn: float) -> float:
        """The way to where it touches, to a thousandth of a piece."""
        for _ in range(10):
            middle = (free + blocked) / 2
            if self._fits(middle, turn):
                free = middle
            else:
                blocked = middle
        return free

    def _fits(self, forward: float, turn: float) -> bool:
        return self._room.clearance(self.pose.ahead(forward, turn / 2)) >= RADIUS_M


@dataclass(slots=True)
class Battery:
    """What is left, in %. Standing costs little, driving and turning cost more."""

    percent: float
    charging: bool = False
    rate: float = 0.0
    """%/s now; positive when charging."""

    IDLE = 0.02  # %/s
    DRIVING = 2.2  # %/m
    TURNING = 0.3  # %/rad
    CHARGING = 10.0  # %/s

    @property
    def empty(self) -> bool:
        return self.percent <= 0

    @property
    def full(self) -> bool:
        return self.percent >= 100

    def step(
        self, seconds: float, driven_m: float, turned_rad: float, *, charging: bool
    ) -> None:
        """What so many seconds take from it or, at the charger, give to it."""
        used = (
            self.IDLE * seconds + self.DRIVING * driven_m + self.TURNING * turned_rad
        )
        change = self.CHARGING * seconds - used if charging else -used
        before = self.percent
        self.percent = min(max(before + change, 0.0), 100.0)
        self.charging = charging
        self.rate = (self.percent - before) / seconds
