"""The boxes that planes, displays and axes are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .axes import Array

# The six sides of a box: which way is ahead for a camera that looks at the side, and which way is up in its picture.
_SIDES = tuple(
    (np.array(ahead, dtype=float), np.array(up, dtype=float))
    for ahead, up in (
        ((0, 0, 1), (0, 1, 0)),
        ((0, 0, -1), (0, 1, 0)),
        ((1, 0, 0), (0, 1, 0)),
        ((-1, 0, 0), (0, 1, 0)),
        ((0, 1, 0), (0, 0, -1)),
        ((0, -1, 0), (0, 0, 1)),
    )
)

_STANDARD = 2500.0
"""Edge of a plane without a size, mm."""


class Bar(NamedTuple):
    """The box of one axis."""

    axis: str
    """x, y or z."""
    middle: tuple[float, float, float]
    """mm."""
    size: tuple[float, float, float]
    """Width, height and depth, mm."""
    colour: tuple[int, int, int]


def bars(length: float, width: float) -> Iterator[Bar]:
    """What a node `axes` looks like: three boxes that begin at its origin; lengths in mm."""
    for number, (axis, colour) in enumerate({"x": (220, 50, 50), "y": (60, 170, 60), "z": (50, 90, 220)}.items()):
        along = [each == number for each in range(3)]
        x, y, z = (length / 2.0 if each else 0.0 for each in along)
        across, up, ahead = (length if each else width for each in along)
        yield Bar(axis, (x, y, z), (across, up, ahead), colour)


def extents(size: Sequence[float]) -> Array:
    """Width, height and depth in mm, shape (3,), of the attribute `size`.

    Of one number, the height is the width, and the depth a hundredth of it; of two, the depth is a hundredth of the
    smaller one. A minus has no effect.
    """
    numbers = [abs(float(each)) for each in size] or [_STANDARD]
    if len(numbers) == 1:
        numbers.append(numbers[0])
    if len(numbers) == 2:
        numbers.append(min(numbers) / 100.0)
    return np.array(numbers[:3])


def pictured(sizes: Array) -> tuple[Array, Array, NDArray[np.int32]]:
    """A box of which each side shows a whole picture, upright: `sizes` are width, height and depth.

    Its points, shape (24, 3), in the axes of the node; the places of these points on the picture, shape (24, 2), from
    its upper left corner, 0, to the lower right one, 1; and its triangles, shape (12, 3), which run counter-clockwise
    from outside in right-handed axes.
    """
    points: list[Array] = []
    places: list[tuple[float, float]] = []
    faces: list[tuple[int, int, int]] = []
    for ahead, up in _SIDES:
        right = np.cross(up, ahead)
        corners = [(-1, 1), (1, 1), (1, -1), (-1, -1)]  # from the upper left one, clockwise
        begin = len(points)
        points += [(right * x + up * y - ahead) * (sizes / 2.0) for x, y in corners]
        places += [((x + 1) / 2, (1 - y) / 2) for x, y in corners]
        faces += [(begin, begin + 3, begin + 2), (begin, begin + 2, begin + 1)]
    return np.array(points), np.array(places), np.array(faces, dtype=np.int32)
