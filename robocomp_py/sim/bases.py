"""How a base moves at a speed, and what its wheels tell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple


class Speed(NamedTuple):
    """In the frame of the base."""

    ahead: float = 0.0
    """mm/s, along z."""
    aside: float = 0.0
    """mm/s, along x, to the right."""
    turn: float = 0.0
    """rad/s, to the right."""


class Pose(NamedTuple):
    """In the frame of the parent of the base."""

    x: float
    """mm."""
    z: float
    """mm."""
    turn: float
    """rad, to the right; not normalised."""


@dataclass(slots=True)
class Drive:
    """What a base was told, and where it believes to be."""

    speed: Speed
    expires: int | None
    """The tick at which it stops unless it is told again; None: never."""
    odometry: Pose
    corrected: Pose
    """The last correction, moved on by the odometry since."""


def moved(pose: Pose, speed: Speed, time: float) -> Pose:
    """Where a base is after some seconds of constant speed: exact, since it drives along an arc of a circle."""
    half = speed.turn * time / 2
    chord = time * (math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6)
    sine, cosine = math.sin(pose.turn + half), math.cos(pose.turn + half)
    return Pose(
        pose.x + chord * (speed.ahead * sine + speed.aside * cosine),
        pose.z + chord * (speed.ahead * cosine - speed.aside * sine),
        pose.turn + speed.turn * time,
    )


def in_parent(pose: Pose, speed: Speed, time: float) -> tuple[float, float]:
    """The mean speeds along z and x of the parent of a base, mm/s, while it drives for some seconds."""
    turn = pose.turn + speed.turn * time / 2
    sine, cosine = math.sin(turn), math.cos(turn)
    return speed.ahead * cosine - speed.aside * sine, speed.ahead * sine + speed.aside * cosine


def between(pose: Pose, other: Pose, time: float) -> Speed:
    """The constant speed that leads from one pose to another in some seconds: the inverse of `moved`."""
    half = (other.turn - pose.turn) / 2
    chord = time * (math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6)
    sine, cosine = math.sin(pose.turn + half), math.cos(pose.turn + half)
    x, z = (other.x - pose.x) / chord, (other.z - pose.z) / chord
    return Speed(x * sine + z * cosine, x * cosine - z * sine, 2 * half / time)
