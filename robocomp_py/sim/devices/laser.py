"""A laser scanner: a fan of rays in the plane of x and z of its node."""

from __future__ import annotations

import mujoco
import numpy as np

from ...innermodel import axes
from ...innermodel.axes import Array
from ...innermodel.camera import laser_angles
from ...innermodel.read import InnerModelError
from ...innermodel.tree import Node
from ..build import Frame


class Laser:
    """Measures distances; it never hits the body that it is part of."""

    def __init__(self, node: Node, frame: Frame) -> None:
        """Raises InnerModelError for a laser whose range is empty."""
        rays, field, low, high = (float(str(node.values[each])) for each in ("measures", "angle", "min", "max"))
        if rays < 1 or not 0.0 <= low < high:
            raise InnerModelError(
                f"`{node.id}`: a laser needs `measures` of 1 or more, and 0 ≤ `min` < `max`; "
                f"it has {rays:.0f}, {low:g} and {high:g}",
                node=node.id,
            )
        self.angles = laser_angles(field, int(rays))
        """Of its rays, shape (measures,), rad to the right, from the right to the left."""
        self._low, self._high, self._body = low, high, frame.body
        points = np.stack((np.sin(self.angles), np.zeros(int(rays)), np.cos(self.angles)), axis=1)
        self._directions = points @ axes.TO_SIMULATION.T @ frame.rotation.T
        self._position = frame.position
        self._hit = np.empty(int(rays), dtype=np.int32)
        self._metres = np.empty(int(rays))

    def scan(self, model: mujoco.MjModel, data: mujoco.MjData, deviations: Array | None = None) -> Array:
        """Distances in mm, shape (measures,), at least `min` and at most `max`.

        `deviations` in mm are added to what is hit. The poses of all bodies in `data` have to be those of now.
        """
        turn = data.xmat[self._body].reshape(3, 3)
        origin = data.xpos[self._body] + turn @ self._position
        directions = np.ascontiguousarray(self._directions @ turn.T)
        own = self._body or -1  # what is fixed to the world may see all else that is
        mujoco.mj_multiRay(
            model, data, origin, directions.ravel(), None, True, own, self._hit, self._metres, None,
            len(self._metres), self._high / 1000.0 * 1.01 + 1.0,
        )  # fmt: skip
        distances = np.where(self._hit < 0, self._high, self._metres * 1000.0)
        if deviations is not None:
            distances = np.where(self._hit < 0, distances, distances + deviations)
        found: Array = np.clip(distances, self._low, self._high)
        return found
