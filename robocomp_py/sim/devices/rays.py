"""Rays from a node, and how far they go."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...innermodel import axes
from ...innermodel.axes import Array
from ..build import Frame


class Rays:
    """They never hit the body that they are part of."""

    def __init__(self, frame: Frame, directions: Array, reach: float) -> None:
        """`directions` are within the node, of length 1, shape (n, 3). Rays go at least `reach` mm far."""
        self._directions = directions @ axes.TO_SIMULATION.T @ frame.rotation.T
        self._position, self._body = frame.position, frame.body
        self._reach = reach / 1000.0 * 1.01 + 1.0

    def cast(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, NDArray[np.bool_]]:
        """How far they go, mm, and which hit something, both of shape (n,). Distances of the others mean nothing.

        The poses of all bodies in `data` have to be those of now.
        """
        turn = data.xmat[self._body].reshape(3, 3)
        origin = data.xpos[self._body] + turn.dot(self._position)
        directions = self._directions.dot(turn.T)
        count = len(directions)
        hit, metres = np.empty(count, dtype=np.int32), np.empty(count)  # not kept: copies of a world share the rays
        own = self._body or -1  # what is fixed to the world may see all else that is
        mujoco.mj_multiRay(
            model, data, origin, directions.ravel(), None, True, own, hit, metres, None, count, self._reach
        )
        metres *= 1000.0
        return metres, hit >= 0
