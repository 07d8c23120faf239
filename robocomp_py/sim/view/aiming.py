"""Where a new page looks from: all of a scene is in sight, whatever the size of the window."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import viser

from ...innermodel.axes import Array

_AWAY = np.array((-0.7, -0.3, 0.8)) / math.sqrt(1.22)
"""From what a new page looks at to where it looks from."""
_RIGHT = np.array((0.3, -0.7, 0.0)) / math.sqrt(0.58)
_UP = np.cross(_AWAY, _RIGHT)
_FIELD = 0.7
"""How far a point may be from the middle of the picture, upwards, divided by its distance: that of viser is 0.77."""
_USUAL = 0.7
"""Width by height of a picture that is not known yet. Most windows are wider."""
_NEAREST = 1.5
"""A new page looks from no nearer than this, m."""
_NARROW = 576
"""In a window of fewer pixels, viser puts its panel over the lower part of the scene, and else beside it."""


class Aim:
    """The camera of a page. It looks at all of a scene until the user of the page looks elsewhere."""

    def __init__(self, camera: viser.CameraHandle, parts: Sequence[Array], covered: float) -> None:
        """`covered` is the part of the height that the panel takes in a narrow window."""
        self._parts = parts
        self._free = 1.0 - covered if camera.image_width < _NARROW else 1.0
        self._size = (0, 0)
        self._place = np.zeros(3)
        self._aimed = 0.0
        self._is_there = self._is_over = False
        self._aim(camera)

        async def changed(camera: viser.CameraHandle) -> None:
            self._follow(camera)

        camera.on_update(changed)

    def _follow(self, camera: viser.CameraHandle) -> None:
        if self._is_over or camera.update_timestamp == self._aimed:  # else the page has told something since
            return
        if np.allclose(camera.position, self._place, atol=1e-3):
            self._is_there = True
        elif self._is_there:
            self._is_over = True
            return
        if (camera.image_width, camera.image_height) != self._size:
            self._aim(camera)

    def _aim(self, camera: viser.CameraHandle) -> None:
        self._size = width, height = camera.image_width, camera.image_height
        look_at, self._place = viewpoint(self._parts, aspect=width / max(height, 1), free=self._free)
        self._is_there = False
        camera.position = self._place  # first: it moves what the camera looks at, too
        camera.look_at = look_at
        self._aimed = camera.update_timestamp


def viewpoint(parts: Sequence[Array], *, aspect: float = _USUAL, free: float = 1.0) -> tuple[Array, Array]:
    """Where a camera looks and stands to have all parts in sight, each an array of points: m, shape (3,).

    It stands behind them, to the right and above. `aspect` is the width of the picture divided by its height; the parts
    are in its upper part, `free` of its height.
    """
    points = np.concatenate(parts) if parts else np.zeros((1, 3))
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    aside, upwards, nearer = ((points - middle) @ np.stack((_RIGHT, _UP, _AWAY), axis=1)).T
    side, half, raised = _FIELD * aspect, _FIELD * free, _FIELD * (1.0 - free)
    needed = (
        np.abs(aside) / side + nearer,
        (upwards + (half + raised) * nearer) / half,
        ((half - raised) * nearer - upwards) / half,
    )
    away = max(_NEAREST, float(np.max(needed)))
    look_at = middle - raised * away * _UP
    return look_at, look_at + away * _AWAY
