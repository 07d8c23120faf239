"""How fast things move, and their true poses in m and rad.

Products are made by `dot`: for so few numbers, `@` takes twice as long.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from ..innermodel import axes
from ..innermodel.axes import Array
from .build import Frame

_BODY = mujoco.mjtObj.mjOBJ_XBODY


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
    rotation: Array
    """From the node to the root, shape (3, 3)."""


def update_speeds(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute the speeds of all bodies, whose poses have to be those of now."""
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)


def speed_of(model: mujoco.MjModel, data: mujoco.MjData, frame: Frame) -> tuple[Array, Array]:
    """The velocity of the origin of a frame, m/s, and its angular velocity, rad/s, in the axes of the simulator.

    The speeds of all bodies in `data` have to be those of now.
    """
    return _speed(model, data, frame.body, data.xmat[frame.body].reshape(3, 3).dot(frame.position))


def _speed(model: mujoco.MjModel, data: mujoco.MjData, body: int, away: Array) -> tuple[Array, Array]:
    """The velocity and the turning of a point that is `away` from the origin of a body, m."""
    found = np.empty(6)
    mujoco.mj_objectVelocity(model, data, _BODY, body, found, 0)
    turning = found[:3]
    return found[3:] + axes.cross(turning, away), turning


def truth(model: mujoco.MjModel, data: mujoco.MjData, frame: Frame) -> Truth:
    """The poses and speeds of all bodies in `data` have to be those of now."""
    turn = data.xmat[frame.body].reshape(3, 3)
    away = turn.dot(frame.position)
    velocity, turning = _speed(model, data, frame.body, away)
    rotation = axes.TO_SIMULATION.T.dot(turn.dot(frame.rotation)).dot(axes.TO_SIMULATION)
    return Truth(
        (data.xpos[frame.body] + away).dot(axes.TO_SIMULATION) + 0.0,
        axes.angles(rotation),
        velocity.dot(axes.TO_SIMULATION) + 0.0,
        axes.turn_from_simulation(turning),
        rotation,
    )
