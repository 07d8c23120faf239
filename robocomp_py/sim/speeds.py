"""How fast things move, and their true poses in m and rad."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from ..innermodel import axes
from ..innermodel.axes import Array
from .build import Frame


class Truth(NamedTuple):
    """Where a node is and how it moves, in the axes of the root: x to the right, y up, z ahead."""

    position: Array
    """Shape (3,), m."""
    angles: Array
    """rx, ry, rz, shape (3,), rad; see `axes.angles`."""
    velocity: Array
    """Shape (3,), m/s."""
    turning: Array
    """Angular velocity, shape (3,), rad/s; a turn to the right is positive about y."""


def update_speeds(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute the speeds of all bodies, whose poses have to be those of now."""
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)


def speed_of(model: mujoco.MjModel, data: mujoco.MjData, frame: Frame) -> tuple[Array, Array]:
    """The velocity of the origin of a frame, m/s, and its angular velocity, rad/s, in the axes of the simulator.

    The speeds of all bodies in `data` have to be those of now.
    """
    found = np.empty(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, frame.body, found, 0)
    turning, velocity = found[:3], found[3:]
    away = data.xmat[frame.body].reshape(3, 3) @ frame.position
    return velocity + axes.cross(turning, away), turning


def truth(model: mujoco.MjModel, data: mujoco.MjData, frame: Frame) -> Truth:
    """The poses and speeds of all bodies in `data` have to be those of now."""
    velocity, turning = speed_of(model, data, frame)
    turn = data.xmat[frame.body].reshape(3, 3)
    return Truth(
        (data.xpos[frame.body] + turn @ frame.position) @ axes.TO_SIMULATION,
        axes.angles(axes.rotation_from_simulation(turn @ frame.rotation)),
        velocity @ axes.TO_SIMULATION,
        axes.turn_from_simulation(turning),
    )
