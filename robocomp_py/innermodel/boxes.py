"""The boxes that planes and displays are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .axes import Array

_STANDARD = 2500.0
"""Edge of a plane without a size, mm."""


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
