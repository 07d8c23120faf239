"""What a scene looks like: the colours and pictures of its shapes, its light, and where its cameras are.

Only a renderer needs that, so it has a model of its own, which `build` makes from the same tree. Both have the same
bodies and joints, and therefore the same vector of positions.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..innermodel import axes
from ..innermodel.axes import Array
from ..innermodel.boxes import bars, pictured
from ..innermodel.camera import Lens
from ..innermodel.mesh import read_mesh
from ..innermodel.pictures import GREY, Pixels, colour_of, read_picture
from ..innermodel.read import InnerModelError, number_of
from ..innermodel.tree import Node, Tree
from .drawing import FARTHEST, NEAREST

log = logging.getLogger("robocomp.sim")

CAMERAS = ("rgbd", "camera")
"""The tags of nodes that take pictures."""

_MOST_PIXELS = 4096
"""Of a row or a column of what a camera takes."""
_MOST_COLOURS = 64
"""Of a mesh."""
_LEAST_AREA = 1e-12
"""Of a face that is drawn, m²."""

_UNTOUCHED = {"contype": 0, "conaffinity": 0}
"""Of shapes that are only seen: MuJoCo computes no convex hulls of them."""


@dataclass(slots=True)
class Looks:
    """What is added to a model that is drawn."""

    tree: Tree
    spec: mujoco.MjSpec
    shown: Mapping[str, Pixels]
    """What displays show, by their ids. The others show their colour."""
    lenses: dict[str, Lens] = field(init=False)
    """Of its cameras."""
    textures: dict[Path | str, str] = field(default_factory=dict)
    """The names of materials, by the file of the picture or the id of the display."""
    meshes: dict[tuple[Path, tuple[float, ...]], list[tuple[str, tuple[float, ...]]]] = field(default_factory=dict)
    """The names and the colours of the meshes of a file, by the file and its scale."""
    boxes: dict[tuple[float, ...], str] = field(default_factory=dict)
    """The names of meshes of boxes with places on a picture, by their half extents."""

    def __post_init__(self) -> None:
        spec = self.spec
        spec.stat.extent = 1.0  # distances below are in m then
        spec.visual.map.znear, spec.visual.map.zfar = NEAREST, FARTHEST
        spec.visual.quality.offsamples = 0  # a sample is not at the centre of its pixel: depths would differ
        # A face of a box in one piece: lights that are far away, without highlights, colour it evenly.
        spec.visual.quality.numquads = 1
        light = spec.visual.headlight
        light.ambient, light.diffuse, light.specular = [0.5] * 3, [0.3] * 3, [0.0] * 3
        spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            dir=axes.TO_SIMULATION @ (0.3, -1.0, 0.5),
            diffuse=[0.2] * 3,
            specular=[0.0] * 3,
            castshadow=False,
        )
        self.lenses = {name: lens_of(self.tree.node(name)) for name in cameras(self.tree)}
        spec.visual.global_.offwidth = max((round(each.width) for each in self.lenses.values()), default=1)
        spec.visual.global_.offheight = max((round(each.height) for each in self.lenses.values()), default=1)

    @property
    def displays(self) -> dict[str, str]:
        """The names of the textures of displays, by their ids."""
        return {key: name for key, name in self.textures.items() if isinstance(key, str)}

    def add_camera(self, body: mujoco.MjsBody, node: Node, name: str, within: Array) -> None:
        """`within` is the pose in `body`, in mm and our axes."""
        lens = self.lenses[node.id]
        backwards = np.diag((1.0, 1.0, -1.0))  # cameras of MuJoCo look along -z
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, (axes.TO_SIMULATION @ within[:3, :3] @ backwards).ravel())
        body.add_camera(
            name=name,
            pos=axes.position_to_simulation(within[:3, 3]),
            quat=turn,
            fovy=float(np.degrees(2 * np.arctan2(lens.height / 2, lens.focal))),
        )

    def add_axes(self, body: mujoco.MjsBody, node: Node, within: Array) -> None:
        """Add the boxes of `axes`, at a pose in `body`, in mm and our axes."""
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, axes.rotation_to_simulation(within[:3, :3]).ravel())
        length, width = (number_of(node.values[each]) for each in ("length", "width"))
        for bar in bars(length, width):
            across, up, ahead = bar.size
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=np.maximum(np.array((ahead, across, up)) / 2000.0, 1e-6),
                pos=axes.position_to_simulation(within[:3, :3] @ bar.middle + within[:3, 3]),
                quat=turn,
                rgba=(*(each / 255 for each in bar.colour), 1.0),
                **_UNTOUCHED,
            )

    def dress(self, shape: mujoco.MjsGeom, node: Node) -> None:
        """Give the box of a plane or a display its picture, which each side shows upright. `shape` has its size."""
        material = self._material(node)
        if material:
            half = tuple(float(each) for each in shape.size)
            if half not in self.boxes:
                self.boxes[half] = self._box(half)
            shape.type, shape.meshname, shape.material = mujoco.mjtGeom.mjGEOM_MESH, self.boxes[half], material
            shape.rgba = (1.0, 1.0, 1.0, 1.0)
            shape.contype = shape.conaffinity = 0

    def add_mesh(self, body: mujoco.MjsBody, path: Path, scale: tuple[float, ...], pose: Mapping[str, Any]) -> None:
        """Add the shape of a file, a mesh for each of its colours, at a pose in `body`."""
        if (path, scale) not in self.meshes:
            self.meshes[path, scale] = self._pieces(path, scale)
        for name, colour in self.meshes[path, scale]:
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=(*colour, 1.0), **_UNTOUCHED, **pose)

    def _pieces(self, path: Path, scale: tuple[float, ...]) -> list[tuple[str, tuple[float, ...]]]:
        """The names and the colours of the meshes of a file."""
        mesh = read_mesh(path, scale)
        points = axes.position_to_simulation(mesh.vertices)
        found: list[tuple[str, tuple[float, ...]]] = []
        for colour, faces in pieces(points, mesh.faces, mesh.colours):
            used, places = np.unique(faces, return_inverse=True)
            corners = points[used]
            corners = np.concatenate((corners, corners[: max(0, 4 - len(corners))]))  # MuJoCo wants four or more
            name = f"mesh{len(self.meshes)}.{len(found)}"
            made = self.spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
            made.uservert, made.userface = corners.ravel(), places.astype(np.int32).ravel()
            found.append((name, colour))
        return found

    def _material(self, node: Node) -> str:
        """The name of the material of a plane; "" for one that has a colour."""
        text = str(node.values["texture"])
        if node.tag == "display":
            key: Path | str = node.id
        elif not text or colour_of(text):
            return ""
        else:
            found = self.tree.file(node.id, "texture")
            if found is None:
                log.warning("`%s` is grey: there is no file `%s`", node.id, text)
                return ""
            key = found
        if key not in self.textures:
            pixels = self.shown.get(node.id, _blank(text)) if isinstance(key, str) else picture_of(key)
            if pixels is None:
                return ""
            self.textures[key] = self._texture(pixels)
        return self.textures[key]

    def _texture(self, pixels: Pixels) -> str:
        name = f"picture{len(self.textures)}"
        height, width, _ = pixels.shape
        made = self.spec.add_texture(
            name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3
        )
        made.data = pixels.tobytes()
        material = self.spec.add_material(name=name)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        return name

    def _box(self, half: tuple[float, ...]) -> str:
        """The mesh of a box with these half extents in simulation: every side has a whole picture."""
        depth, width, height = half
        points, places, faces = pictured(2.0 * np.array((width, height, depth)))
        name = f"box{len(self.boxes)}"
        made = self.spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        made.uservert = (points @ axes.TO_SIMULATION.T).ravel()
        made.usertexcoord = places.ravel()
        made.userface = made.userfacetexcoord = faces.ravel()
        return name


def pieces(
    points: Array, faces: NDArray[np.int32], colours: Pixels
) -> Iterator[tuple[tuple[float, ...], NDArray[np.int32]]]:
    """The colours of a mesh, each with its faces. Faces without an area are left out.

    A mesh of many colours has those of a coarser palette.
    """
    first, second, third = (points[faces[:, corner]] for corner in range(3))
    seen = np.linalg.norm(np.cross(second - first, third - first), axis=1) > _LEAST_AREA
    faces, colours = faces[seen], colours[seen]
    for step in (1, 16, 64, 256):
        palette, which = np.unique(colours // step, axis=0, return_inverse=True)
        if len(palette) <= _MOST_COLOURS:
            break
    for number in range(len(palette)):
        of_it = which.ravel() == number
        red, green, blue = (colours[of_it].mean(axis=0) / 255).tolist()
        yield (red, green, blue), faces[of_it]


def cameras(tree: Tree) -> list[str]:
    """The nodes that take pictures: those that have a width."""
    return [name for name, tag in tree.tags.items() if tag in CAMERAS and tree.node(name).values["width"] != 0]


def lens_of(node: Node) -> Lens:
    """Raises InnerModelError for a camera that cannot take a picture."""
    width, height, focal = (number_of(node.values[each]) for each in ("width", "height", "focal"))
    if not (1 <= width <= _MOST_PIXELS and 1 <= height <= _MOST_PIXELS and focal > 0):
        raise InnerModelError(
            f"`{node.id}`: a camera needs `width` and `height` from 1 to {_MOST_PIXELS}, and `focal` above 0; "
            f"it has {width:g}, {height:g} and {focal:g}"
        )
    return Lens(width, height, focal)


def picture_of(path: Path) -> Pixels | None:
    """The picture of a file. None, with a warning, if it cannot be read."""
    try:
        return read_picture(path)
    except InnerModelError as exc:
        log.warning("%s", exc)
        return None


def _blank(texture: str) -> Pixels:
    """What a display shows before it is sent a picture: its colour."""
    colour = colour_of(texture) or GREY
    return np.full((1, 1, 3), [round(each * 255) for each in colour[:3]], dtype=np.uint8)
