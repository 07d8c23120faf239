"""How a base moves at a speed, and what its wheels tell."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, sin
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


Three = tuple[float, float, float]
"""A `Pose` or a `Speed`, or its numbers only, which take less time to make."""


@dataclass(slots=True)
class Drive:
    """What a base was told, and where it believes to be."""

    speed: Speed
    expires: int | None
    """The tick at which it stops unless it is told again; None: never."""
    odometry: Three
    corrected: Three
    """The last correction, moved on by the odometry since."""
    wheels: Three = (0.0, 0.0, 0.0)
    """The speed that its wheels had in the last tick; what it was told, before the next one."""


Arc = tuple[float, float, float, float, float]
"""A motion of some seconds at a constant speed, wherever it begins: along an arc of a circle."""


def arc(speed: Three, time: float) -> Arc:
    """The motion of a base at a constant speed, `time` in s."""
    ahead, aside, turn = speed
    half = turn * time / 2
    chord = time * (sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6)
    return ahead, aside, half, chord, turn * time


def extent(motion: Arc) -> tuple[float, float]:
    """How far a base gets by a motion, m, and how far it turns, rad; neither is negative."""
    ahead, aside, _, chord, turn = motion
    return hypot(ahead, aside) * abs(chord) / 1000.0, abs(turn)


def along(pose: Three, motion: Arc, count: int = 1, unit: float = 1.0) -> Three:
    """The exact pose of a base after a motion that begins at `pose`, or after as many of them.

    `unit` is the unit of the lengths in `pose`, mm. Many motions in one call have the same bits as in many calls.
    """
    (x, z, turned), (ahead, aside, half, chord, turn) = pose, motion
    for _ in range(count):
        sine, cosine = sin(turned + half), cos(turned + half)
        x = (x * unit + chord * (ahead * sine + aside * cosine)) / unit
        z = (z * unit + chord * (ahead * cosine - aside * sine)) / unit
        turned += turn
    return x, z, turned


def moved(pose: Three, speed: Three, time: float) -> Three:
    """Where a base is after some seconds of constant speed."""
    return along(pose, arc(speed, time))


def in_parent(pose: Three, speed: Three, time: float) -> tuple[float, float]:
    """The mean speeds along z and x of the parent of a base, mm/s, while it drives for some seconds."""
    (_, _, turned), (ahead, aside, turn) = pose, speed
    sine, cosine = sin(turned + turn * time / 2), cos(turned + turn * time / 2)
    return ahead * cosine - aside * sine, ahead * sine + aside * cosine


def between(pose: Three, other: Three, time: float) -> Three:
    """The constant speed that leads from one pose to another in some seconds: the inverse of `moved`."""
    (x, z, turned), (to_x, to_z, turn) = pose, other
    half = (turn - turned) / 2
    chord = time * (sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6)
    sine, cosine = sin(turned + half), cos(turned + half)
    x, z = (to_x - x) / chord, (to_z - z) / chord
    return x * sine + z * cosine, x * cosine - z * sine, 2 * half / time
