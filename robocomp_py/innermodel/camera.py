"""What cameras and lasers see, in their own frames: x to the right, y up, z ahead, in mm.

Pixels are (column, row), counted from the upper left corner; the centre of the first one is at (0.5, 0.5). The
principal point is in the middle of the picture. Depth is along z, not along the ray.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .axes import Array


class Lens(NamedTuple):
    width: float
    """Columns of the picture."""
    height: float
    """Rows of the picture."""
    focal: float
    """Pixels."""


def projected(lens: Lens, point: Sequence[float] | Array) -> Array:
    """The pixel at which a camera sees a point, shape (2,); NaN if it is not before the camera."""
    x, y, z = point
    if z <= 0.0:
        return np.full(2, math.nan)
    return np.array((lens.width / 2 + lens.focal * x / z, lens.height / 2 - lens.focal * y / z))


def back_projected(lens: Lens, pixel: Sequence[float], depth: float) -> Array:
    """The point that a camera sees at a pixel with this depth, shape (3,)."""
    if lens.focal <= 0.0:
        raise ValueError("a camera without a focal length sees no points")
    column, row = pixel
    x, y = (column - lens.width / 2) / lens.focal, (lens.height / 2 - row) / lens.focal
    return np.array((x * depth, y * depth, depth))


def laser_point(distance: float, angle: float) -> Array:
    """The point at a distance, and at an angle in rad to the right of z, shape (3,)."""
    return np.array((distance * math.sin(angle), 0.0, distance * math.cos(angle)))


def laser_angles(field: float, rays: int) -> Array:
    """The angles of a laser's rays, shape (rays,), in rad: from the right to the left; the last end is not reached."""
    made: Array = np.linspace(field / 2, -field / 2, rays, endpoint=False, dtype=np.float64)
    return made
