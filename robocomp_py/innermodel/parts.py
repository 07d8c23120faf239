"""What readers of mesh files return."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .axes import Array

GREY: Array = np.full(3, 128.0)
"""What has no colour."""
GREY.flags.writeable = False


class Part(NamedTuple):
    """Triangles of one mesh in the axes of its file."""

    vertices: Array
    """Shape (n, 3)."""
    faces: NDArray[np.int64]
    """Numbers of vertices, shape (m, 3); counter-clockwise from outside."""
    colours: NDArray[np.uint8]
    """Red, green and blue of each face, shape (m, 3)."""
