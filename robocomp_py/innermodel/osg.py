"""Shapes from `.osg` files: the text format of OpenSceneGraph, before version 3.

A file has nested blocks. A line is a word and its values. The first line of a block ends with `{`, or `{` is the next
line. Geometries are read, with their transforms and colours. Textures, states and animations are left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .axes import Array
from .parts import GREY, Part

_DEEPEST = 200
"""Maximum depth of nested blocks."""

_MOST_VISITS = 100_000
"""Maximum number of blocks that are read; a block counts each time that it is used."""
_WORD = re.compile(r'"[^"]*"|[{}]|[^\s{}]+')
_TRIANGLES = {"TRIANGLES", "TRIANGLE_STRIP", "TRIANGLE_FAN", "QUADS", "QUAD_STRIP", "POLYGON"}


@dataclass(slots=True)
class _Block:
    head: list[str]
    """The words before `{`."""
    lines: list[list[str]] = field(default_factory=list)
    blocks: list[_Block] = field(default_factory=list)

    def line(self, key: str) -> list[str]:
        """The values of the first line that begins with a word; none if there is no such line."""
        return next((words[1:] for words in self.lines if words[0] == key), [])

    def block(self, *keys: str) -> _Block | None:
        return next((each for each in self.blocks if each.head and each.head[0] in keys), None)

    def numbers(self) -> Array:
        return np.array([float(word) for words in self.lines for word in words])


def read_osg(text: str) -> list[Part]:
    """The parts of a file. Raises ValueError for one that is wrong."""
    reading = _Reading()
    return [part for block in _parsed(text).blocks for part in reading.parts(block, np.eye(4), GREY, 0)]


def _parsed(text: str) -> _Block:
    top = _Block([])
    stack = [top]
    for number, line in enumerate(text.splitlines(), 1):
        words = _WORD.findall(line)
        if words == ["}"]:
            if len(stack) == 1:
                raise ValueError(f"line {number}: `}}` closes nothing")
            stack.pop()
        elif words and words[-1] == "{":
            parent = stack[-1]
            head = words[:-1] or (parent.lines.pop() if parent.lines else [])
            parent.blocks.append(_Block(head))
            stack.append(parent.blocks[-1])
            if len(stack) > _DEEPEST:
                raise ValueError(f"line {number}: more than {_DEEPEST} blocks in each other")
        elif words:
            stack[-1].lines.append(words)
    if len(stack) > 1:
        raise ValueError(f"the block `{' '.join(stack[-1].head)}` has no end")
    return top


class _Reading:
    """Goes through the blocks of a file. One with a name may be used again and again."""

    def __init__(self) -> None:
        self._named: dict[str, _Block] = {}
        self._visits = 0

    def parts(self, block: _Block, pose: Array, colour: Array, depth: int) -> Iterator[Part]:
        """The parts of a block and of those in it. `pose` has columns where OpenSceneGraph has rows."""
        self._visits += 1
        if depth > _DEEPEST or self._visits > _MOST_VISITS:
            raise ValueError("a block that uses itself, or too many uses of blocks")
        for name in block.line("UniqueID"):
            self._named.setdefault(name, block)
        pose, colour = pose @ _pose(block), _material(block, colour)
        if block.head and block.head[0].rpartition("::")[2] == "Geometry":
            yield from _geometry(block, pose, colour)
        for each in block.blocks:
            yield from self.parts(each, pose, colour, depth + 1)
        for words in block.lines:
            if words[0] == "Use" and len(words) == 2 and words[1] in self._named:
                yield from self.parts(self._named[words[1]], pose, colour, depth + 1)


def _pose(block: _Block) -> Array:
    """The transform that a block applies to those in it, shape (4, 4)."""
    matrix = block.block("Matrix") if block.head and block.head[0].endswith("MatrixTransform") else None
    if matrix:
        return matrix.numbers().reshape(4, 4).T
    made = np.eye(4)
    if block.head and block.head[0].endswith("PositionAttitudeTransform"):
        x, y, z, w = map(float, block.line("attitude") or ("0", "0", "0", "1"))
        turn = np.array(
            (
                (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
                (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
                (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
            )
        )
        scale, position, pivot = (
            np.array([float(word) for word in block.line(key) or (usual,) * 3])
            for key, usual in (("scale", "1"), ("position", "0"), ("pivotPoint", "0"))
        )
        made[:3, :3] = turn * scale
        made[:3, 3] = position - made[:3, :3] @ pivot
    return made


def _material(block: _Block, colour: Array) -> Array:
    """Red, green and blue from 0 to 255: of the block's material, or else `colour`."""
    state = block.block("StateSet", "GeoState")
    material = state.block("Material") if state else None
    words = [word for word in (material.line("diffuseColor") if material else []) if word != "FRONT"]
    return np.array([float(word) for word in words[:3]]) * 255 if len(words) >= 3 else colour


def _geometry(block: _Block, pose: Array, colour: Array) -> Iterator[Part]:
    array = block.block("VertexArray", "Vertices", "CoordArray")
    sets = block.block("PrimitiveSets", "Primitives")
    if array is None or sets is None:
        return
    points = array.numbers().reshape(-1, 3)
    vertices: Array = points @ pose[:3, :3].T + pose[:3, 3]
    faces = _faces(sets)
    if faces.size and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise ValueError(f"a geometry of {len(vertices)} points uses number {faces.max()}")
    if np.linalg.det(pose[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    yield Part(vertices, faces, _colours(block, faces, len(vertices), colour))


def _colours(block: _Block, faces: NDArray[np.int64], points: int, colour: Array) -> NDArray[np.uint8]:
    """A colour for each face: the mean of those of its corners, if the geometry has colours. Shape (n, 3)."""
    array = block.block("ColorArray", "Colors")
    binding = block.line("ColorBinding")[:1]
    if array and binding in (["OVERALL"], ["PER_VERTEX"]):
        factor = 1.0 if "Vec4ubArray" in array.head else 255.0
        values = array.numbers().reshape(-1, 4)[:, :3] * factor
        if binding == ["OVERALL"]:
            colour = values[0]
        elif len(values) == points:
            mixed: NDArray[np.uint8] = np.clip(values[faces].mean(axis=1), 0, 255).astype(np.uint8)
            return mixed
    return np.tile(np.clip(colour, 0, 255).astype(np.uint8), (len(faces), 1))


def _faces(sets: _Block) -> NDArray[np.int64]:
    """The triangles of all primitives, as numbers of points, shape (n, 3)."""
    found: list[NDArray[np.int64]] = []
    for words in sets.lines:
        if words[0] == "DrawArrays" and len(words) >= 4:
            first, count = int(words[2]), int(words[3])
            found.append(_triangles(words[1], np.arange(first, first + _bounded(count))))
    for each in sets.blocks:
        numbers = each.numbers().astype(np.int64)
        if each.head[0].startswith("DrawElements") and len(each.head) >= 2:
            found.append(_triangles(each.head[1], numbers))
        elif each.head[0] == "DrawArrayLengths" and len(each.head) >= 3:
            first = int(each.head[2])
            for count in numbers.tolist():
                found.append(_triangles(each.head[1], np.arange(first, first + _bounded(count))))
                first += count
    return np.concatenate(found) if found else np.empty((0, 3), dtype=np.int64)


def _bounded(count: int) -> int:
    if not 0 <= count <= 10_000_000:
        raise ValueError(f"a primitive of {count} points")
    return count


def _triangles(kind: str, points: NDArray[np.int64]) -> NDArray[np.int64]:
    """The triangles of a primitive, shape (n, 3); none of points and lines."""
    count = len(points)
    if kind not in _TRIANGLES or count < 3:
        return np.empty((0, 3), dtype=np.int64)
    match kind:
        case "TRIANGLES":
            return points[: count // 3 * 3].reshape(-1, 3)
        case "TRIANGLE_STRIP":
            made = np.stack((points[:-2], points[1:-1], points[2:]), axis=1)
            made[1::2] = made[1::2, [1, 0, 2]]
            return made
        case "QUADS":
            corners = points[: count // 4 * 4].reshape(-1, 4)
        case "QUAD_STRIP":
            pairs = points[: count // 2 * 2].reshape(-1, 2)
            corners = np.stack((pairs[:-1, 0], pairs[:-1, 1], pairs[1:, 1], pairs[1:, 0]), axis=1)
        case _:  # a fan, or a polygon
            return np.stack((np.full(count - 2, points[0]), points[1:-1], points[2:]), axis=1)
    return np.concatenate((corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]))
