"""Edits of a running scene: each is checked when it is asked for, and all of them take effect together, by `settle`.

    editing = Editing(world)
    editing.add_transform("shelf", "static", "world", (0, 0, 3000, 0, 0, 0))
    editing.add_plane("board", "shelf", Box((0, 0, 0), (0, 1, 0), (900, 300, 20), "#886644"))
    editing.settle()

An edit that cannot be made raises EditError and changes nothing. Lengths are in mm, angles in rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..errors import RobocompError
from ..innermodel import axes
from ..innermodel.axes import Array
from ..innermodel.mesh import read_mesh
from ..innermodel.nodes import TAGS, Value
from ..innermodel.read import MOST_NODES, ROOT_ID, InnerModelError, number_of, numbers_of
from ..innermodel.tree import Node, Tree
from ..spelling import unknown
from .build import build
from .parameters import BASES, JOINTS, SHAPES
from .world import Overlap, World

STAYS = (ROOT_ID, "world")
"""Nodes that are neither removed nor moved."""

MOST_NOTES = 1000
"""On a node."""

MOST_POINTS = 1_000_000
"""In a cloud of points."""

_FARTHEST = 1e9
"""mm or rad."""


class EditError(RobocompError):
    """What is asked cannot be done. `code` is the name of one of the errors of InnerModelManager."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code


class Box(NamedTuple):
    """A plane, which is a box."""

    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    size: tuple[float, float, float]
    """Width, height and depth; the depth is along the normal."""
    texture: str = ""


class Cloud(NamedTuple):
    """Points that were set."""

    points: Array
    """Shape (n, 3), mm."""
    colours: Array
    """From 0 to 255, shape (n, 3)."""
    version: int
    """Another one each time."""


class Editing:
    """Edits of a world, and questions about it that see all edits so far."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._first = world.tree
        self._draft: Tree | None = None
        self._placed: dict[str, Array] = {}
        """Poses within their parents of bases and free bodies that are moved by the edits."""
        self._notes: dict[str, dict[str, tuple[str, str]]] = {}
        self.clouds: dict[str, Cloud] = {}
        """By the ids of their nodes."""
        self._clouds_set = 0

    @property
    def tree(self) -> Tree:
        """The tree with all edits. It is not to be changed."""
        return self._draft or self._world.tree

    def settle(self) -> bool:
        """Let the edits take effect; returns whether there were any.

        Raises EditError if the scene cannot be simulated with them, or if a base would be inside of what stops it.
        Then all edits since the last call are dropped.
        """
        tree, placed = self._draft, self._placed
        if tree is None:
            return False
        self._draft, self._placed = None, {}
        try:
            self._world.change(tree, placed)
        except Overlap as exc:
            raise EditError("Collision", str(exc)) from exc
        except InnerModelError as exc:
            raise EditError("InternalError", str(exc)) from exc
        return True

    def reset(self, seed: int) -> None:
        """Let the world begin again with the tree that it had at first, and without notes and points.

        Raises InnerModelError if that tree cannot be used any more; then all stays as it is.
        """
        self._world.reset(seed, self._first)
        self._draft, self._placed, self._notes, self.clouds = None, {}, {}, {}

    # Nodes.

    def add_transform(self, item: str, engine: str, base: str, pose: Sequence[float]) -> None:
        """Add a frame; `engine` is `static`, or "" for it, or `bullet` for a body that moves freely."""
        if engine not in ("", "static", "bullet"):
            raise EditError("InvalidEngine", f"{engine!r} is no engine: it is `static` or `bullet`")
        values: dict[str, Value] = {"engine": engine or "static", **_posed(pose)}
        self._add(item, base, "transform", values)

    def add_joint(
        self, item: str, base: str, pose: Sequence[float], axis: str, low: float, high: float, port: int
    ) -> None:
        """Add a joint that turns about an axis; it begins at 0, or at the limit that is next to it."""
        if axis not in ("x", "y", "z"):
            raise EditError("InvalidValues", f"{axis!r} is no axis: it is `x`, `y` or `z`")
        if not low <= high:
            raise EditError("InvalidValues", f"limits from {low:g} to {high:g}")
        if port < 0:
            raise EditError("InvalidValues", f"{port} is no port")
        self._add(item, base, "joint", {"axis": axis, "min": low, "max": high, "port": port, **_posed(pose)})
        self._change().update_joint(item, 0.0)

    def add_mesh(
        self, item: str, base: str, pose: Sequence[float], path: str, scale: Sequence[float], wireframe: bool
    ) -> None:
        """Add a shape from a file: an absolute path, or one from the folder of the scene."""
        render = "wireframe" if wireframe else "normal"
        values: dict[str, Value] = {"file": path, "scale": _positive("scale", scale), "render": render, **_posed(pose)}
        self._add(item, base, "mesh", values, check_file=True)

    def add_plane(self, item: str, base: str, box: Box) -> None:
        """Add a box."""
        self._add(item, base, "plane", _boxed(box))

    def remove(self, item: str) -> None:
        """Remove a node with all below it, and the notes on them."""
        self._movable(item)
        for name in _below(self.tree, item):
            self._notes.pop(name, None)
            self.clouds.pop(name, None)
            self._placed.pop(name, None)
        self._change().remove(item)

    def move(self, item: str, parent: str) -> None:
        """Put a node below another parent. It keeps its pose within its parent."""
        self._movable(item)
        above = self._node(parent)
        if not TAGS[above.tag].has_children:
            raise EditError("OperationInvalidNode", f"`{parent}` is a {above.tag}, which has no children")
        if parent in _below(self.tree, item):
            raise EditError("OperationInvalidNode", f"`{parent}` is below `{item}`")
        with _Checked(self, item):
            if _is_free(self._node(item)):
                self._placed[item] = self._local(item)
            self._change().move(item, parent)

    # Poses.

    def set_pose(self, base: str, item: str, pose: Sequence[float]) -> None:
        """Put a node where a pose says that is seen from `base`."""
        self._node(base)
        node = self._movable(item)
        seen = axes.pose(_finite(pose)[:3], axes.rotation(*_finite(pose)[3:]))
        self._set(node, axes.inverse(self._where(node.parent)) @ self._where(base) @ seen)

    def set_pose_from_parent(self, item: str, pose: Sequence[float]) -> None:
        """Put a node where a pose within its parent says."""
        node = self._movable(item)
        self._set(node, axes.pose(_finite(pose)[:3], axes.rotation(*_finite(pose)[3:])))

    def matrix(self, base: str, item: str) -> Array:
        """The matrix that leads from `item` to `base`, shape (4, 4), as things truly are."""
        self._node(base), self._node(item)
        found: Array = axes.inverse(self._where(base)) @ self._where(item)
        return found

    def point(self, base: str, item: str, point: Sequence[float]) -> tuple[float, ...]:
        """A point of the frame `item`, seen from `base`: x, y, z."""
        made: Array = self.matrix(base, item) @ (*_finite(point), 1.0)
        return tuple(made[:3].tolist())

    def pose(self, base: str, item: str) -> tuple[float, ...]:
        """The pose of a node, seen from `base`: x, y, z, rx, ry, rz."""
        return _numbers(self.matrix(base, item))

    def pose_from_parent(self, item: str) -> tuple[float, ...]:
        """The pose of a node within its parent; of the root, within itself."""
        return self.pose(self._node(item).parent or item, item)

    def set_plane(self, item: str, box: Box) -> None:
        """Set the place, the size and the texture of a box."""
        node, values = self._node(item), _boxed(box)
        if node.tag not in ("plane", "display"):
            raise EditError("OperationInvalidNode", f"`{item}` is a {node.tag}, not a plane")
        with _Checked(self, item):
            try:
                self._change().set_values(item, values)
            except InnerModelError as exc:
                raise EditError("InvalidValues", str(exc)) from exc

    def set_scale(self, item: str, scale: Sequence[float]) -> None:
        """Set the scale of a shape from a file."""
        node, checked = self._node(item), _positive("scale", scale)
        if node.tag != "mesh":
            raise EditError("OperationInvalidNode", f"`{item}` is a {node.tag}, not a mesh")
        with _Checked(self, item):
            self._check_mesh(self.tree, item, checked)
            self._change().set_value(item, "scale", checked)

    def collide(self, one: str, other: str) -> bool:
        """Whether shapes at or below two nodes overlap."""
        self._node(one), self._node(other)
        self.settle()
        return self._world.collide(one, other)

    # Notes, and points.

    def notes(self, item: str) -> dict[str, tuple[str, str]]:
        """The notes on a node: type and value by name."""
        self._node(item)
        return dict(self._notes.get(item, {}))

    def add_note(self, item: str, name: str, kind: str, value: str) -> None:
        """Add a note to a node."""
        found = self.notes(item)
        if name in found:
            raise EditError("AttributeAlreadyExists", f"`{item}` has an attribute `{name}` already")
        if len(found) >= MOST_NOTES:
            raise EditError("InternalError", f"`{item}` has {MOST_NOTES} attributes, and cannot have more")
        self._notes.setdefault(item, {})[name] = kind, value

    def set_note(self, item: str, name: str, kind: str, value: str) -> None:
        """Change a note."""
        self.note(item, name)
        self._notes[item][name] = kind, value

    def note(self, item: str, name: str) -> tuple[str, str]:
        """Type and value of a note."""
        found = self.notes(item)
        if name not in found:
            raise EditError("NonExistingAttribute", f"`{item}`: {unknown('attribute', name, found)}")
        return found[name]

    def remove_note(self, item: str, name: str) -> None:
        """Remove a note."""
        self.note(item, name)
        del self._notes[item][name]

    def set_cloud(self, item: str, points: Array, colours: Array) -> None:
        """Set the points of a cloud, in mm, and their colours, from 0 to 255; shapes (n, 3)."""
        node = self._node(item)
        if node.tag != "pointcloud":
            raise EditError("OperationInvalidNode", f"`{item}` is a {node.tag}, not a pointcloud")
        if len(points) > MOST_POINTS:
            raise EditError("InvalidValues", f"{len(points)} points; at most {MOST_POINTS}")
        self._clouds_set += 1
        self.clouds[item] = Cloud(points, colours, self._clouds_set)

    # How it is done.

    def _change(self) -> Tree:
        """The tree to edit."""
        if self._draft is None:
            self._draft = self._world.tree.copy()
        return self._draft

    def _node(self, name: str) -> Node:
        tree = self.tree
        if name not in tree:
            raise EditError("NonExistingNode", unknown("node", name, tree.ids))
        return tree.node(name)

    def _movable(self, name: str) -> Node:
        node = self._node(name)
        if name in STAYS:
            raise EditError("OperationInvalidNode", f"`{name}` stays as it is")
        return node

    def _add(self, item: str, base: str, tag: str, values: dict[str, Value], *, check_file: bool = False) -> None:
        above = self._node(base)
        if item in self.tree:
            raise EditError("NodeAlreadyExists", f"there is a `{item}` already")
        if not TAGS[above.tag].has_children:
            raise EditError("OperationInvalidNode", f"`{base}` is a {above.tag}, which has no children")
        if len(self.tree) >= MOST_NODES:
            raise EditError("InternalError", f"the scene has {MOST_NODES} nodes, and cannot have more")
        tree = self._change()
        try:
            tree.add(base, tag, item, **values)
        except InnerModelError as exc:
            raise EditError("InvalidValues", str(exc)) from exc
        if check_file:
            try:
                self._check_mesh(tree, item, None)
            except EditError:
                tree.remove(item)
                raise

    def _check_mesh(self, tree: Tree, item: str, scale: tuple[float, ...] | None) -> None:
        """Raises EditError for a mesh that cannot be read or simulated."""
        values, path = tree.node(item).values, tree.file(item)
        if path is None:
            raise EditError("InvalidPath", f"`{item}`: there is no file `{values['file']}`")
        alone, used = Tree(), scale or numbers_of(values["scale"])
        try:
            read_mesh(path, used)
            alone.add(ROOT_ID, "mesh", item, file=str(path.resolve()), scale=used)
            build(alone, self._world.tick)
        except InnerModelError as exc:
            raise EditError("InvalidPath", str(exc)) from exc

    def _set(self, node: Node, local: Array) -> None:
        """Put a node where a matrix within its parent says."""
        if not np.isfinite(local).all() or np.abs(local).max() > _FARTHEST:
            raise EditError("InvalidValues", "the pose is too far away")
        with _Checked(self, node.id):
            if node.tag in BASES:
                self._set_base(node, local)
            elif _is_free(node):
                self._change()
                self._placed[node.id] = local
            else:
                self._set_values(node, local)

    def _set_base(self, node: Node, local: Array) -> None:
        """What a base does not move by itself, its height and tilt, is a part of the tree."""
        pose = _numbers(local)
        values = dict(zip(("ty", "rx", "rz"), (pose[1], pose[3], pose[5]), strict=True))
        for key, value in values.items():
            if number_of(node.values[key]) != value:
                self._change().set_value(node.id, key, value)
        self._change()
        self._placed[node.id] = local

    def _set_values(self, node: Node, local: Array) -> None:
        if node.tag == "joint":  # its pose includes its turn, which stays
            angle = self._world.position(node.id) if node.id in self._world.joints else self.tree.position(node.id)
            local = local @ axes.pose((0.0, 0.0, 0.0), axes.about(str(node.values["axis"]), angle).T)
        has_translation, has_rotation = "tx" in node.values, "rx" in node.values
        if not has_translation and not has_rotation:
            raise EditError("OperationInvalidNode", f"`{node.id}` is a {node.tag}, which has no pose of its own")
        pose = _numbers(local)
        if not has_rotation and not np.allclose(local[:3, :3], np.eye(3), rtol=0, atol=1e-6):
            raise EditError("InvalidValues", f"`{node.id}` is a translation, and cannot be turned")
        if not has_translation and not np.allclose(local[:3, 3], 0.0, rtol=0, atol=1e-6):
            raise EditError("InvalidValues", f"`{node.id}` is a rotation, and cannot be moved")
        if has_translation and has_rotation:
            self._change().update_transform(node.id, pose)
        elif has_translation:
            self._change().update_translation(node.id, pose[:3])
        else:
            self._change().update_rotation(node.id, pose[3:])

    def _where(self, name: str) -> Array:
        """Where a node truly is, seen from the root. Of what cannot move, the tree knows it before edits settle."""
        above = name
        while above and not _moves(self._node(above)):
            above = self._node(above).parent
        if not above:
            return self.tree.matrix(ROOT_ID, name)
        self.settle()
        return self._world.matrix(name)

    def _local(self, name: str) -> Array:
        """Where a node truly is within its parent."""
        made: Array = axes.inverse(self._where(self._node(name).parent)) @ self._where(name)
        return made

    def _may_collide(self, name: str) -> bool:
        """Whether a move of a node may lead a base into what stops it."""
        tree, bases = self.tree, [each for each in self.tree.ids if self.tree.node(each).tag in BASES]
        if not any(tree.node(each).values["collide"] for each in bases):
            return False
        nodes = map(tree.node, _below(tree, name))
        return any(each.tag in (*BASES, *SHAPES) and each.values["collide"] for each in nodes)


class _Checked:
    """Around an edit that may lead a base into what stops it: it takes effect alone and at once, or not at all."""

    def __init__(self, editing: Editing, item: str) -> None:
        self._editing = editing
        self._at_once = editing._may_collide(item)

    def __enter__(self) -> None:
        if self._at_once:
            self._editing.settle()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._at_once and kind is None:
            self._editing.settle()


def _below(tree: Tree, name: str) -> list[str]:
    """A node and all below it."""
    found, waiting = [], [name]
    while waiting:
        found.append(name := waiting.pop())
        waiting += tree.node(name).children
    return found


def _moves(node: Node) -> bool:
    return node.tag in (*BASES, *JOINTS) or _is_free(node)


def _is_free(node: Node) -> bool:
    return node.values.get("engine") == "bullet"


def _numbers(matrix: Array) -> tuple[float, ...]:
    return (*matrix[:3, 3].tolist(), *axes.angles(matrix[:3, :3]).tolist())


def _posed(pose: Sequence[float]) -> dict[str, Value]:
    return dict(zip(("tx", "ty", "tz", "rx", "ry", "rz"), _finite(pose), strict=True))


def _boxed(box: Box) -> dict[str, Value]:
    names = ("px", "py", "pz", "nx", "ny", "nz")
    values: dict[str, Value] = dict(zip(names, _finite((*box.point, *box.normal)), strict=True))
    return {**values, "size": _positive("size", box.size), "texture": box.texture}


def _finite(numbers: Sequence[float]) -> tuple[float, ...]:
    for each in numbers:
        if not math.isfinite(each) or abs(each) > _FARTHEST:
            raise EditError("InvalidValues", f"{each:g} is no length in mm and no angle in rad")
    return tuple(map(float, numbers))


def _positive(what: str, numbers: Sequence[float]) -> tuple[float, ...]:
    if not all(0.0 < each <= _FARTHEST for each in numbers):
        raise EditError("InvalidValues", f"a {what} of {', '.join(f'{each:g}' for each in numbers)}: more than 0 each")
    return tuple(map(float, numbers))
