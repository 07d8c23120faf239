"""A laser scanner: a fan of rays in the plane of x and z of its node."""

from __future__ import annotations

import mujoco
import numpy as np

from ...innermodel.axes import Array
from ...innermodel.camera import laser_angles
from ...innermodel.read import InnerModelError, number_of
from ...innermodel.tree import Node
from ..build import Frame
from .rays import Rays


class Laser:
    """Measures distances; it never hits the body that it is part of."""

    def __init__(self, node: Node, frame: Frame) -> None:
        """Raises InnerModelError for a laser whose range is empty."""
        self.angles = angles(node)
        """Of its rays, shape (measures,), rad to the right, from the right to the left."""
        self._low, self._high = limits(node)
        zeros = np.zeros(len(self.angles))
        directions = np.stack((np.sin(self.angles), zeros, np.cos(self.angles)), axis=1)
        self._rays = Rays(frame, directions, self._high)

    def scan(self, model: mujoco.MjModel, data: mujoco.MjData, deviations: Array | None = None) -> Array:
        """Distances in mm, shape (measures,), at least `min` and at most `max`.

        `deviations` in mm are added to what is hit. The poses of all bodies in `data` have to be those of now.
        """
        distances, hit = self._rays.cast(model, data)
        if deviations is not None:
            distances += deviations
        distances[~hit] = self._high
        np.maximum(distances, self._low, out=distances)  # `np.clip` takes twice as long for so few numbers
        return np.minimum(distances, self._high, out=distances)


def limits(node: Node) -> tuple[float, float]:
    """The least and the greatest distance of a node `laser`, mm. Raises InnerModelError if it measures nothing."""
    rays, low, high = (number_of(node.values[each]) for each in ("measures", "min", "max"))
    if rays < 1 or not 0.0 <= low < high:
        raise InnerModelError(
            f"`{node.id}`: a laser needs `measures` of 1 or more, and 0 ≤ `min` < `max`; "
            f"it has {rays:.0f}, {low:g} and {high:g}",
            node=node.id,
        )
    return low, high


def angles(node: Node) -> Array:
    """The directions of the rays of a node `laser`, rad to the right, shape (measures,). Raises as `limits` does."""
    limits(node)
    return laser_angles(number_of(node.values["angle"]), int(number_of(node.values["measures"])))
