"""Shapes from files. Most are read by trimesh, which the extra `[sim]` has.

The z of a mesh file points towards the viewer, that of InnerModel ahead. So a point of the file is mirrored in z; see
`Mesh`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .axes import Array
from .nodes import MESH_FORMATS
from .osg import read_osg
from .parts import Part
from .read import InnerModelError
from .studio3d import read_3ds

_BINARY = ("ive", "osgb", "osgt", "osgx")

_MOST_FACES = 2_000_000


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles in the axes of the node: x to the right, y up, z ahead; mm."""

    vertices: Array
    """Shape (n, 3), mm."""
    faces: NDArray[np.int32]
    """Numbers of vertices, shape (m, 3); seen from outside, they run counter-clockwise in right-handed axes."""
    colours: NDArray[np.uint8]
    """Red, green and blue of each face, shape (m, 3). A texture gives a face the colour at its middle."""


def read_mesh(path: Path, scale: Sequence[float] = (1.0,)) -> Mesh:
    """Read a shape. `scale` is one number, or one for each axis; of two, the first counts for z as well.

    Raises InnerModelError if the file is not there, is of another kind, or has no triangles.
    """
    parts = _read(path)
    before = np.cumsum([0, *(len(part.vertices) for part in parts)])
    if sum(len(part.faces) for part in parts) == 0:
        raise InnerModelError(f"{path}: the mesh has no triangles")
    vertices: Array = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + first for part, first in zip(parts, before, strict=False)])
    if len(faces) > _MOST_FACES:
        raise InnerModelError(f"{path}: the mesh has {len(faces)} triangles, and at most {_MOST_FACES} are read")
    if not np.isfinite(vertices).all():
        raise InnerModelError(f"{path}: the mesh has points that are not finite")
    factors = _factors(scale)
    if np.prod(factors) < 0.0:
        faces = faces[:, ::-1]  # it is mirrored
    colours = np.concatenate([part.colours for part in parts])
    return Mesh(vertices * factors * (1.0, 1.0, -1.0), faces.astype(np.int32), colours)


def _read(path: Path) -> list[Part]:
    ending = path.suffix.lower().removeprefix(".")
    if ending in _BINARY:
        raise InnerModelError(
            f"{path}: this is a format of OpenSceneGraph that only it reads; convert it, by its tool: "
            f"osgconv {path.name} {path.stem}.obj"
        )
    if ending not in MESH_FORMATS:
        known = ", ".join(f".{each}" for each in MESH_FORMATS)
        raise InnerModelError(f"{path}: meshes are read from {known}; convert it, with Blender for example")
    try:
        if ending == "osg":
            return read_osg(path.read_text(encoding="utf-8", errors="replace"))
        if ending == "3ds":
            return read_3ds(path.read_bytes())
    except (OSError, ValueError) as exc:
        raise InnerModelError(f"{path}: the mesh cannot be read: {exc}") from exc
    try:
        import trimesh
    except ImportError as exc:
        raise InnerModelError(f"{path}: meshes need `pip install 'robocomp-py[sim]'` ({exc})") from exc
    try:
        scene = trimesh.load_scene(path, process=False)
        places = [scene.graph[name] for name in scene.graph.nodes_geometry]
        meshes = [(scene.geometry[name], matrix) for matrix, name in places]
        return [_part(mesh, matrix) for mesh, matrix in meshes if isinstance(mesh, trimesh.Trimesh)]
    except Exception as exc:  # its readers raise what their formats happen to raise
        raise InnerModelError(f"{path}: the mesh cannot be read: {exc or type(exc).__name__}") from exc


def _part(mesh: Any, matrix: Array) -> Part:
    """A mesh of trimesh, which has a pose in its file."""
    vertices: Array = np.asarray(mesh.vertices, dtype=float) @ matrix[:3, :3].T + matrix[:3, 3]
    faces: NDArray[np.int64] = np.asarray(mesh.faces, dtype=np.int64)
    colours = _colours(mesh.visual, faces)[:, :3].astype(np.uint8)
    return Part(vertices, faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else faces, colours)


def _colours(visual: Any, faces: NDArray[np.int64]) -> NDArray[Any]:
    """Colours of faces, shape (m, 3) or (m, 4); grey if the file has none."""
    if visual.kind == "face":
        return np.asarray(visual.face_colors)
    if visual.kind == "vertex":
        corners: NDArray[Any] = np.asarray(visual.vertex_colors)[faces]
        return np.asarray(corners.mean(axis=1))
    if visual.kind != "texture":
        return np.full((len(faces), 3), 128)
    image = getattr(visual.material, "image", None) or getattr(visual.material, "baseColorTexture", None)
    if image is None or visual.uv is None:
        return np.tile(np.asarray(visual.material.main_color), (len(faces), 1))
    pixels = np.asarray(image.convert("RGB"))
    across, up = np.moveaxis(np.asarray(visual.uv)[faces].mean(axis=1) % 1.0, -1, 0)
    height, width, _ = pixels.shape
    row, column = ((1.0 - up) * height).astype(int) % height, (across * width).astype(int) % width
    found: NDArray[Any] = pixels[row, column]
    return found


def _factors(scale: Sequence[float]) -> Array:
    numbers = [float(each) for each in scale] or [1.0]
    if len(numbers) == 1:
        return np.full(3, numbers[0])
    return np.array((numbers[0], numbers[1], numbers[2] if len(numbers) > 2 else numbers[0]))
