"""How the motor of a joint moves: to a position at a speed, or at a speed that it approaches at an acceleration."""

from __future__ import annotations

import math
from typing import NamedTuple


class To(NamedTuple):
    """A goal: a position."""

    position: float
    speed: float
    """How fast it is approached; more than 0."""


class At(NamedTuple):
    """A goal: a speed."""

    speed: float
    acceleration: float
    """How fast the speed changes; 0: at once."""


class Motor(NamedTuple):
    """Where the motor of a joint holds it: rad and rad/s, or mm and mm/s if it slides."""

    position: float
    speed: float = 0.0
    goal: To | At | None = None
    """None: it stands still."""


def moved(motor: Motor, time: float, low: float, high: float) -> Motor:
    """What a motor does after some seconds; at `low` and `high` it stops."""
    match motor.goal:
        case None:
            return motor
        case To(position, speed):
            most = speed * time
            if abs(position - motor.position) <= most:
                return Motor(position)
            speed = math.copysign(speed, position - motor.position)
            return Motor(motor.position + speed * time, speed, motor.goal)
        case At(wanted, acceleration):
            position, speed = _accelerated(motor, wanted, acceleration, time)
            within = min(max(position, low), high)
            if (within == low and speed < 0.0) or (within == high and speed > 0.0):
                speed = 0.0
            stays = speed == 0.0 and (
                wanted == 0.0 or (within == low and wanted < 0.0) or (within == high and wanted > 0.0)
            )
            return Motor(within, speed, None if stays else motor.goal)


def _accelerated(motor: Motor, wanted: float, acceleration: float, time: float) -> tuple[float, float]:
    """Position and speed after some seconds: the speed grows evenly, and stays when it is the wanted one."""
    change = wanted - motor.speed
    needed = abs(change) / acceleration if acceleration else 0.0
    if needed > time:
        speed = motor.speed + math.copysign(acceleration * time, change)
        return motor.position + (motor.speed + speed) / 2 * time, speed
    return motor.position + (motor.speed + wanted) / 2 * needed + wanted * (time - needed), wanted
