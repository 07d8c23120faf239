"""An inertial unit: what acts on it, how fast it turns, and how it is turned."""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np

from ...innermodel import axes
from ...innermodel.axes import Array
from ..build import Frame
from ..speeds import speed_of

_NORTH = np.array((0.0, 0.0, 1.0))
"""The direction of the magnetic field: the z of the world."""


class Inertial(NamedTuple):
    """What an inertial unit measures, in its own frame."""

    acceleration: Array
    """Proper acceleration, shape (3,), m/s²: at rest +9.81 upwards, in free fall 0; the mean over a tick."""
    gyroscope: Array
    """Shape (3,), rad/s; a turn to the right is positive about y."""
    magnetic: Array
    """The direction of the magnetic field, shape (3,), of length 1."""
    roll: float
    """About z, rad."""
    pitch: float
    """About x, rad; positive downwards."""
    yaw: float
    """About y, rad; to the right."""


class Inertia(NamedTuple):
    """What an inertial unit remembers, in the axes of the simulator."""

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m/s."""
    acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m/s²."""
    yaw: float = 0.0
    """What its yaw was when it was last reset, rad."""


def read(model: mujoco.MjModel, data: mujoco.MjData, frame: Frame, acceleration: Array) -> Inertial:
    """Measure. `acceleration` is that of the unit in the axes of the simulator, shape (3,), m/s².

    The poses and speeds of all bodies in `data` have to be those of now.
    """
    turn = data.xmat[frame.body].reshape(3, 3) @ frame.rotation
    own = axes.rotation_from_simulation(turn)
    _, turning = speed_of(model, data, frame)
    return Inertial(
        (acceleration - model.opt.gravity) @ turn @ axes.TO_SIMULATION + 0.0,  # 0, and not -0
        axes.turn_from_simulation(turning @ turn),
        _NORTH @ own,
        math.atan2(own[1, 0], own[1, 1]),
        math.asin(min(1.0, max(-1.0, 0.0 - own[1, 2]))),
        math.atan2(own[0, 2], own[2, 2]),
    )
