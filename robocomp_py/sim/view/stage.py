"""The scene on a page: shapes become objects of viser, and only what differs is sent."""

from __future__ import annotations

import inspect
import math
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
import viser
from PIL import Image

from ...innermodel import axes
from ...innermodel.axes import Array
from ...innermodel.boxes import pictured
from ...innermodel.mesh import Mesh
from ...innermodel.read import ROOT_ID
from .aiming import Aim, viewpoint
from .shapes import Block, Cloud, Eye, Fan, Form, Gallery, Pictured, Shape, Surface

Picked = Callable[[str, int], object]
"""Gets the id of a node that was clicked, and the number of the page. To a coroutine function, clicks come in order."""

_REACH = 500.0
"""Length of what shows the directions of a laser, mm."""
_RAYS = 24
_POINT = 0.02
"""Size of a point of a cloud, m."""
_CORNERS = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_SUN = (-30.0, 50.0, 100.0)
"""Where light comes from: each side of a box that a new page sees gets another part of it."""
_EYE: tuple[int, int, int] = (40, 40, 40)
_LASER: tuple[int, int, int] = (230, 60, 40)


@dataclass(slots=True)
class _Shown:
    shape: Shape
    handle: Any


class Stage:
    """What is shown of a scene on all pages of a server. Its methods may be called from any thread."""

    def __init__(self, server: viser.ViserServer, gallery: Gallery, picked: Picked | None = None) -> None:
        """`picked` is called on a thread of viser, or awaited on that of its event loop."""
        self._server, self._gallery, self._picked = server, gallery, picked
        self._shown: dict[tuple[str, str], _Shown] = {}
        self._carriers: dict[str, Any] = {}
        self._lock = threading.RLock()
        self._number = 0
        self._parts: list[Array] = []
        """Points of what does not move, which new pages have in sight."""
        _light(server.scene)

    def show(self, shapes: Iterable[Shape]) -> None:
        """Show these shapes, and no others."""
        with self._lock, self._server.atomic():
            wanted = {(each.node, each.part): each for each in shapes}
            for key in [key for key in self._shown if key not in wanted]:
                self._shown.pop(key).handle.remove()
            for key, shape in wanted.items():
                before = self._shown.get(key)
                if before and before.shape.form == shape.form and before.shape.carrier == shape.carrier:
                    if not np.array_equal(before.shape.pose, shape.pose):
                        _put(before.handle, shape.pose)
                    before.shape = shape
                    continue
                if before:
                    before.handle.remove()
                self._shown[key] = _Shown(shape, self._add(shape))
            if self._shown and not self._parts:
                self._aim()

    def place(self, poses: Mapping[str, Array]) -> None:
        """Move all shapes of carriers at once: poses seen from the root, as the page has them."""
        with self._lock, self._server.atomic():
            for carrier, pose in poses.items():
                _put(self._carrier(carrier), pose)

    def aim(self, camera: viser.CameraHandle, covered: float) -> None:
        """Let a page look at all of it; `covered` is the part of a narrow page that the panel covers."""
        if self._parts:
            Aim(camera, self._parts, covered)

    def _aim(self) -> None:
        """Let new pages look at all of it."""
        still = (each.shape for each in self._shown.values() if each.shape.carrier == ROOT_ID)
        self._parts = [_corners(each, self._gallery) for each in still] or [np.zeros((1, 3))]
        camera = self._server.initial_camera
        camera.look_at, camera.position = viewpoint(self._parts)

    def _carrier(self, name: str) -> Any:
        if name not in self._carriers:
            path = f"/{len(self._carriers)}"
            self._carriers[name] = self._server.scene.add_frame(path, show_axes=False)
        return self._carriers[name]

    def _add(self, shape: Shape) -> Any:
        self._number += 1
        path = f"{self._carrier(shape.carrier).name}/{self._number}"
        where: dict[str, Any] = _pose(shape.pose)
        handle = _added(self._server.scene, path, shape.form, self._gallery, where)
        if self._picked is not None and not isinstance(shape.form, Fan | Cloud):
            handle.on_click(_clicked(self._picked, shape.node))
        return handle


def _light(scene: viser.SceneApi) -> None:
    """Let colours look as the file has them. With viser's own lights, what is seen from above is nearly white.

    There are no shadows: those of viser end in the middle of a large room.
    """
    scene.configure_environment_map(None)
    scene.configure_default_lights(enabled=False)
    scene.add_light_ambient("/light/around", intensity=1.7)
    scene.add_light_directional("/light/sun", intensity=1.8, position=_SUN)


def _corners(shape: Shape, gallery: Gallery) -> Array:
    """Points within a carrier, between which all of a shape is: m, shape (n, 3)."""
    match shape.form:
        case Block(size=size):
            half = np.array(size) / 2.0
        case Pictured(size=size):
            half = axes.position_to_simulation(np.array(size)) / 2.0
        case Surface():
            mesh = gallery.mesh(shape.form)
            assert isinstance(mesh, Mesh)
            return axes.position_to_simulation(mesh.vertices) @ shape.pose[:3, :3].T + shape.pose[:3, 3]
        case _:
            half = np.zeros(3)
    return (_CORNERS * half) @ shape.pose[:3, :3].T + shape.pose[:3, 3]


def _clicked(picked: Picked, node: str) -> Callable[[Any], Any]:
    if not inspect.iscoroutinefunction(picked):
        return lambda event: picked(node, event.client_id)

    async def clicked(event: Any) -> None:
        await picked(node, event.client_id)

    return clicked


def _added(scene: viser.SceneApi, path: str, form: Form, gallery: Gallery, where: dict[str, Any]) -> Any:
    match form:
        case Block(size=size, colour=colour):
            return scene.add_box(path, colour, size, **where)
        case Eye(angle=angle, aspect=aspect):
            return scene.add_camera_frustum(path, angle, aspect, scale=0.15, color=_EYE, **where)
        case Fan(angle=angle):
            return scene.add_line_segments(path, _fan(angle), _LASER, thickness=0.005, **where)
        case Cloud(points=points, colours=colours):
            return scene.add_point_cloud(path, points, colours, point_size=_POINT, precision="float32", **where)
        case Pictured():
            return scene.add_mesh_trimesh(path, _pictured(form, gallery), **where)
        case Surface():
            return _surface(scene, path, form, gallery, where)


def _fan(angle: float) -> Array:
    """Segments, shape (n, 2, 3)."""
    ends = np.linspace(-angle / 2.0, angle / 2.0, _RAYS)
    tips = axes.position_to_simulation(np.stack((np.sin(ends), 0.0 * ends, np.cos(ends)), axis=1) * _REACH)
    arc = np.stack((tips[:-1], tips[1:]), axis=1)
    sides = np.stack((np.zeros((2, 3)), tips[[0, -1]]), axis=1)
    return np.concatenate((arc, sides))


def _pictured(form: Pictured, gallery: Gallery) -> trimesh.Trimesh:
    pixels = gallery.picture(form.path, form.stamp)
    assert not isinstance(pixels, str)
    points, places, faces = pictured(np.array(form.size))
    places[:, 1] = 1.0 - places[:, 1]  # trimesh has its places from the lower left corner
    visuals: Any = trimesh.visual.texture  # it has no types
    paper = visuals.PBRMaterial(baseColorTexture=Image.fromarray(pixels), metallicFactor=0.0, roughnessFactor=1.0)
    look = visuals.TextureVisuals(uv=places, material=paper)
    return trimesh.Trimesh(axes.position_to_simulation(points), faces, visual=look, process=False)


def _surface(scene: viser.SceneApi, path: str, form: Surface, gallery: Gallery, where: dict[str, Any]) -> Any:
    mesh = gallery.mesh(form)
    assert isinstance(mesh, Mesh)
    points = axes.position_to_simulation(mesh.vertices)
    first = mesh.colours[0]
    if form.is_wireframe or (mesh.colours == first).all():
        colour = (int(first[0]), int(first[1]), int(first[2]))
        return scene.add_mesh_simple(
            path,
            points,
            mesh.faces,
            color=colour,
            wireframe=form.is_wireframe,
            flat_shading=True,
            side="double",
            **where,
        )
    corners = np.arange(3 * len(mesh.faces)).reshape(-1, 3)  # a corner has one colour: faces share none
    look = np.repeat(mesh.colours, 3, axis=0)
    made = trimesh.Trimesh(points[mesh.faces].reshape(-1, 3), corners, vertex_colors=look, process=False)
    return scene.add_mesh_trimesh(path, made, **where)


def _pose(matrix: Array) -> dict[str, Any]:
    return {"position": tuple(matrix[:3, 3].tolist()), "wxyz": quaternion(matrix[:3, :3])}


def quaternion(turn: Array) -> tuple[float, float, float, float]:
    """The quaternion w, x, y, z of a rotation, shape (3, 3).

    viser has such a function, too. It computes with arrays of numpy, which takes eight times as long.
    """
    (a, b, c), (d, e, f), (g, h, i) = turn.tolist()
    candidates = (1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i)
    largest = max(range(4), key=candidates.__getitem__)
    size = candidates[largest]
    w, x, y, z = (
        (size, h - f, c - g, d - b),
        (h - f, size, b + d, c + g),
        (c - g, b + d, size, f + h),
        (d - b, c + g, f + h, size),
    )[largest]
    scale = 0.5 / math.sqrt(size)
    return w * scale, x * scale, y * scale, z * scale


def _put(handle: Any, matrix: Array) -> None:
    for name, value in _pose(matrix).items():
        setattr(handle, name, value)
