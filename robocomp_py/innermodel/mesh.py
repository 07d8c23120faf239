"""Shapes from files. They are read by trimesh, which the extra `[sim]` has.

The z of a mesh file points towards the viewer, that of InnerModel ahead. So a point of the file is mirrored in z; see
`Mesh`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .axes import Array
from .read import InnerModelError

FORMATS = ("obj", "stl", "ply", "off", "glb", "gltf")
"""The endings of files that are read."""

_MOST_FACES = 2_000_000


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles in the axes of the node: x to the right, y up, z ahead; mm."""

    vertices: Array
    """Shape (n, 3), mm."""
    faces: NDArray[np.int32]
    """Numbers of vertices, shape (m, 3); seen from outside, they run counter-clockwise in right-handed axes."""


def read_mesh(path: Path, scale: Sequence[float] = (1.0,)) -> Mesh:
    """Read a shape. `scale` is one number, or one for each axis; of two, the first counts for z as well.

    Raises InnerModelError if the file is not there, is of another kind, or has no triangles.
    """
    ending = path.suffix.lower().removeprefix(".")
    if ending not in FORMATS:
        known = ", ".join(f".{each}" for each in FORMATS)
        raise InnerModelError(f"{path}: meshes are read from {known}; convert it, with Blender for example")
    try:
        import trimesh
    except ImportError as exc:
        raise InnerModelError(f"{path}: meshes need `pip install 'robocomp-py[sim]'` ({exc})") from exc
    try:
        loaded = trimesh.load_mesh(path, process=False)
    except Exception as exc:  # its readers raise what their formats happen to raise
        raise InnerModelError(f"{path}: the mesh cannot be read: {exc or type(exc).__name__}") from exc
    vertices, faces = np.asarray(loaded.vertices, dtype=float), np.asarray(loaded.faces, dtype=np.int32)
    if len(faces) == 0:
        raise InnerModelError(f"{path}: the mesh has no triangles")
    if len(faces) > _MOST_FACES:
        raise InnerModelError(f"{path}: the mesh has {len(faces)} triangles, and at most {_MOST_FACES} are read")
    if not np.isfinite(vertices).all():
        raise InnerModelError(f"{path}: the mesh has points that are not finite")
    return Mesh(vertices * _factors(scale) * (1.0, 1.0, -1.0), faces)


def _factors(scale: Sequence[float]) -> Array:
    numbers = [float(each) for each in scale] or [1.0]
    if len(numbers) == 1:
        return np.full(3, numbers[0])
    return np.array((numbers[0], numbers[1], numbers[2] if len(numbers) > 2 else numbers[0]))
