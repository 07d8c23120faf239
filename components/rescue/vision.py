"""Finds red objects in a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Blob:
    """The number of red pixels, and the number of rows and columns that they span."""

    area: int
    height: int
    width: int


NOTHING = Blob(0, 0, 0)


def pixels_of(data: ArrayLike, width: int, height: int) -> Pixels:
    """The bytes of a picture as rows of pixels of red, green and blue."""
    return np.asarray(data, np.uint8).reshape(height, width, 3)


def find_red(pixels: Pixels) -> Blob:
    """Find pixels that are much more red than green and blue."""
    red, green, blue = np.moveaxis(pixels.astype(np.int16), 2, 0)
    mask = (red > 100) & (red > 2 * green) & (red > 2 * blue)
    if not mask.any():
        return NOTHING
    return Blob(int(mask.sum()), _extent(mask.any(axis=1)), _extent(mask.any(axis=0)))


def _extent(hit: NDArray[np.bool_]) -> int:
    """The distance from the first hit to the last, both included."""
    where = np.flatnonzero(hit)
    return int(where[-1] - where[0]) + 1
