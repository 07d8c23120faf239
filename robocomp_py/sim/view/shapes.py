"""What a page shows of a scene: shapes, each with its pose. Made from a tree; knows nothing of the page.

Lengths are in m and axes those of the simulator, which are right-handed: X ahead, Y left, Z up.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...innermodel import axes
from ...innermodel.axes import Array
from ...innermodel.boxes import bars, extents
from ...innermodel.mesh import Mesh, read_mesh
from ...innermodel.pictures import GREY, Pixels, colour_of, read_picture
from ...innermodel.read import ROOT_ID, InnerModelError, number_of, numbers_of
from ...innermodel.tree import Node, Tree

Colour = tuple[int, int, int]
Size = tuple[float, float, float]

LOST: Colour = (200, 60, 200)
"""The colour of a box that stands for a mesh that cannot be read."""

_LOST_SIZE = (0.2, 0.2, 0.2)


class Block(NamedTuple):
    """A box of one colour."""

    size: Size
    """Along X, Y and Z, m."""
    colour: Colour


class Pictured(NamedTuple):
    """A box that has a picture on each side."""

    size: Size
    """Width, height and depth, mm."""
    path: Path
    stamp: int
    """When the file was changed, ns: a changed file is another form."""


class Surface(NamedTuple):
    """The triangles of a file."""

    path: Path
    scale: tuple[float, ...]
    is_wireframe: bool
    stamp: int


class Eye(NamedTuple):
    """A camera. It looks along its Z; its Y is downwards."""

    angle: float
    """The vertical field of view, rad."""
    aspect: float
    """Width by height."""


class Fan(NamedTuple):
    """The directions of a laser in the plane of X and Y, with X in the middle."""

    angle: float
    """The whole field, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points of a running scene. The same object is the same points."""

    points: NDArray[np.float32]
    """Shape (n, 3), m."""
    colours: Pixels
    """Shape (n, 3)."""


Form = Block | Pictured | Surface | Eye | Fan | Cloud


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    node: str
    """The id of the node that it belongs to."""
    part: str
    """Tells the shapes of one node apart."""
    carrier: str
    """The id of the node that it moves with."""
    pose: Array
    """Within the carrier, shape (4, 4)."""
    form: Form


@dataclass(slots=True)
class Gallery:
    """Meshes and pictures of files, each read once until its file changes."""

    _meshes: dict[Surface, Mesh | str] = field(default_factory=dict)
    _pictures: dict[tuple[Path, int], Pixels | str] = field(default_factory=dict)

    def mesh(self, form: Surface) -> Mesh | str:
        """A mesh, or why it cannot be read."""
        if form not in self._meshes:
            try:
                self._meshes[form] = read_mesh(form.path, form.scale)
            except InnerModelError as exc:
                self._meshes[form] = str(exc)
        return self._meshes[form]

    def picture(self, path: Path, stamp: int) -> Pixels | str:
        """A picture, or why it cannot be read."""
        if (path, stamp) not in self._pictures:
            try:
                self._pictures[path, stamp] = read_picture(path)
            except InnerModelError as exc:
                self._pictures[path, stamp] = str(exc)
        return self._pictures[path, stamp]


@dataclass(slots=True)
class Drawing:
    """What is shown of a tree."""

    shapes: list[Shape] = field(default_factory=list)
    troubles: list[str] = field(default_factory=list)
    """What is shown otherwise than the tree has it, for people."""


def drawn(
    tree: Tree, gallery: Gallery, carriers: Collection[str] = (), clouds: Mapping[str, Cloud] = MappingProxyType({})
) -> Drawing:
    """The shapes of a tree. They move with the nearest of the `carriers` at or above them, or with the root.

    `clouds` are the points of each `pointcloud` that has some.
    """
    found = Drawing()
    above: dict[str, str] = {}
    for name in tree.ids:
        node = tree.node(name)
        carrier = name if name in carriers else above.get(node.parent, ROOT_ID)
        above[name] = carrier
        within = tree.matrix(carrier, name)
        if name in clouds:
            found.shapes.append(Shape(name, "", carrier, on_page(within), clouds[name]))
        for part, moved, form in _forms(tree, node, gallery, found.troubles):
            pose = on_page(within @ moved)
            if isinstance(form, Eye):
                pose[:3, :3] = axes.TO_SIMULATION @ (within @ moved)[:3, :3] @ np.diag((1.0, -1.0, 1.0))
            found.shapes.append(Shape(name, part, carrier, pose, form))
    return found


def on_page(matrix: Array) -> Array:
    """A pose of InnerModel, in mm, as the page has it; shape (4, 4)."""
    return axes.pose(axes.position_to_simulation(matrix[:3, 3]).tolist(), axes.rotation_to_simulation(matrix[:3, :3]))


def from_page(matrix: Array) -> Array:
    """The way back of `on_page`."""
    return axes.pose(
        axes.position_from_simulation(matrix[:3, 3]).tolist(), axes.rotation_from_simulation(matrix[:3, :3])
    )


def _forms(tree: Tree, node: Node, gallery: Gallery, troubles: list[str]) -> Iterator[tuple[str, Array, Form]]:
    """The forms of a node, with their names and their poses within it."""
    values, here = node.values, np.eye(4)
    match node.tag:
        case "plane" | "display":
            yield "", here, _plane(tree, node, gallery, troubles)
        case "mesh":
            yield "", here, _mesh(tree, node, gallery, troubles)
        case "rgbd" | "camera":
            width, height, focal = (number_of(values[each]) for each in ("width", "height", "focal"))
            if min(width, height, focal) > 0.0:
                yield "", here, Eye(2.0 * math.atan2(height / 2.0, focal), width / height)
        case "laser":
            if (angle := number_of(values["angle"])) > 0.0:
                yield "", here, Fan(min(angle, 2.0 * math.pi))
        case "axes":
            length, width = number_of(values["length"]), number_of(values["width"])
            for bar in bars(length, width):
                yield bar.axis, axes.pose(bar.middle, np.eye(3)), Block(_block(np.array(bar.size)), bar.colour)


def _plane(tree: Tree, node: Node, gallery: Gallery, troubles: list[str]) -> Form:
    text, size = str(node.values["texture"]), extents(numbers_of(node.values["size"]))
    colour = colour_of(text)
    if text and colour is None and node.tag == "plane":
        path = tree.file(node.id, "texture")
        if path is None:
            troubles.append(f"{_where(tree, node)}`{node.id}` is grey: there is no file `{text}`")
        else:
            changed = stamp(path)
            picture = gallery.picture(path, changed)
            if not isinstance(picture, str):
                width, height, depth = size.tolist()
                return Pictured((width, height, depth), path, changed)
            troubles.append(f"{_where(tree, node)}`{node.id}` is grey: {picture}")
    red, green, blue = (round(255 * each) for each in (colour or GREY)[:3])
    return Block(_block(size), (red, green, blue))


def _mesh(tree: Tree, node: Node, gallery: Gallery, troubles: list[str]) -> Form:
    path = tree.file(node.id)
    problem = f"there is no file `{node.values['file']}`"
    if path is not None:
        is_wireframe = node.values["render"] == "wireframe"
        form = Surface(path, numbers_of(node.values["scale"]), is_wireframe, stamp(path))
        mesh = gallery.mesh(form)
        if not isinstance(mesh, str):
            return form
        problem = mesh
    troubles.append(f"{_where(tree, node)}`{node.id}` is shown as a box: {problem}")
    return Block(_LOST_SIZE, LOST)


def stamp(path: Path) -> int:
    """When a file was changed, ns; 0 if it is not there any more, which its reader tells."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def _where(tree: Tree, node: Node) -> str:
    place = tree.place(node.id)
    return f"{place}: " if place else ""


def _block(size: Array) -> Size:
    """Width, height and depth in mm, as the page has them."""
    width, height, depth = np.round(size * 0.001, 6).tolist()
    return depth, width, height
