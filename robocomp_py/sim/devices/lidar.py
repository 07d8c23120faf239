"""A lidar: the fans of a laser scanner above one another."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from ...innermodel.axes import Array
from ...innermodel.read import InnerModelError
from ...innermodel.tree import Node
from ..build import Frame
from ..parameters import FANS, FIELD
from .laser import angles, limits
from .rays import Rays

MOST_RAYS = 1_000_000


def is_lidar(parameters: Mapping[str, float]) -> bool:
    """Whether the parameters of a node `laser` make it a lidar."""
    return "fans" in parameters or "field" in parameters


class Lidar:
    """Measures points; it never hits the body that it is part of."""

    def __init__(self, node: Node, frame: Frame, parameters: Mapping[str, float]) -> None:
        """Raises InnerModelError for a range that is empty, and for too many rays."""
        around, (self._low, self._high) = angles(node)[::-1], limits(node)
        fans, field = int(parameters.get("fans", FANS)), parameters.get("field", FIELD)
        if fans * len(around) > MOST_RAYS:
            raise InnerModelError(
                f"`{node.id}`: {fans} fans of {len(around)} rays: a lidar has at most {MOST_RAYS} rays", node=node.id
            )
        heights = np.linspace(field / 2, -field / 2, fans) if fans > 1 else np.zeros(1)
        turn, height = (each.ravel() for each in np.meshgrid(around, heights, indexing="ij"))
        self._directions: Array = np.stack(
            (np.sin(turn) * np.cos(height), np.sin(height), np.cos(turn) * np.cos(height)), axis=1
        )
        self._rays = Rays(frame, self._directions, self._high)

    @property
    def count(self) -> int:
        """The number of its rays."""
        return len(self._directions)

    def cloud(self, model: mujoco.MjModel, data: mujoco.MjData, deviations: Array | None = None) -> Array:
        """Points in mm within its node, shape (n, 3), where 0 ≤ n ≤ `count`: from the left to the right, and of one
        direction, from above to below.

        What is nearer than `min` or beyond `max` gives no point. `deviations` in mm, of shape (count,), are added to
        the distances. The poses of all bodies in `data` have to be those of now.
        """
        distances, hit = self._rays.cast(model, data)
        if deviations is not None:
            distances = distances + deviations
        seen = hit & (distances >= self._low) & (distances <= self._high)
        found: Array = self._directions[seen] * distances[seen, None]
        return found
