"""A tree of frames: where things are, seen from one another.

    tree = Tree.read("house.xml")
    tree.update_joint("elbow", 0.4)
    tree.transform("world", (0, 0, 100), "camera")     # a point of the frame `camera`, seen from `world`

Lengths are in mm and angles in rad; axes are those of `axes`. All methods may be called from any thread. They return
values, never nodes: what a caller holds does not change.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple, Self

import numpy as np

from ..spelling import unknown
from . import axes
from .axes import Array
from .camera import Lens, back_projected, laser_point, projected
from .nodes import INCLUDE, ROOT, TAGS, Attribute, Kind, Tag, Value
from .numbers import amiss
from .read import (
    ROOT_ID,
    Element,
    InnerModelError,
    Model,
    Place,
    Problem,
    ReadFile,
    found_file,
    number_of,
    read,
    read_file,
    three_of,
)
from .write import Written, as_text, written

_MOST_CACHED = 4096
"""Pairs of frames whose matrix is kept while nothing moves."""


class Node(NamedTuple):
    """What a node is now."""

    id: str
    tag: str
    parent: str
    """The id of its parent; "" of the root."""
    children: tuple[str, ...]
    values: Mapping[str, Value]
    """Its attributes by name, defaults included."""


_HERE: Array = np.eye(4)
_HERE.flags.writeable = False


class _Node:
    """A node. `stamp` is the number of the change that last moved it within its parent.

    Copies of a tree have the same `values`: they are replaced, and not changed.
    """

    __slots__ = (
        "children",
        "element",
        "id",
        "is_set",
        "latest",
        "local",
        "parent",
        "position",
        "stamp",
        "tag",
        "values",
        "world",
    )

    def __init__(self, tag: Tag, values: dict[str, Value], element: Element | None = None) -> None:
        self.tag, self.values, self.element = tag, values, element
        self.id = str(values["id"])
        self.parent: _Node | None = None
        self.children: list[_Node] = []
        self.position = number_of(values.get("position", 0.0))
        """Of a joint: rad, or mm."""
        self.is_set = False
        """Whether a joint was moved since the tree was read."""
        self.local = _HERE
        self.stamp = 0
        self.world = _HERE
        self.latest = -1
        """The last change that `world` includes."""


class Tree:
    """An InnerModel. Made by `read`, or by `Tree()`, which has only its root."""

    def __init__(self, *, drops_offsets: bool = False) -> None:
        """With `drops_offsets`, a joint that is moved loses the offset that its tag has, as in RoboComp's library."""
        self._lock = threading.RLock()
        self._drops_offsets = drops_offsets
        self._root = _Node(TAGS[ROOT], {"id": ROOT_ID})
        self._nodes: dict[str, _Node] = {ROOT_ID: self._root}
        self._change = 0
        self._matrices: dict[tuple[str, str], tuple[float, ...]] = {}
        self._tags: Mapping[str, str] | None = None
        """None: not yet looked for."""
        self._state = self._origin = object()
        """Trees with the same `_state` are the same. `_origin` is the state that the tree had when it was made."""
        self._touched: set[str] = set()
        """The ids of all nodes that may differ from those of the origin."""
        self._model: Model | None = None
        self._prefixes: Mapping[str, Path] = {}
        self.problems: tuple[Problem, ...] = ()
        """The warnings about its files."""

    @classmethod
    def read(
        cls,
        path: Path | str,
        *,
        prefixes: Mapping[str, Path] | None = None,
        drops_offsets: bool = False,
        reading: ReadFile = read_file,
    ) -> Self:
        """Read a file. Raises InnerModelError with all that is wrong; about `prefixes` see `read.read`."""
        model = read(Path(path), prefixes=prefixes, reading=reading)
        if model.errors:
            raise InnerModelError("\n".join(map(str, model.errors)), model.problems)
        tree = cls(drops_offsets=drops_offsets)
        tree._model, tree.problems, tree._prefixes = model, model.problems, dict(prefixes or {})
        for element in model.elements:
            tree._adopt(element, tree._root)
        return tree

    @property
    def version(self) -> int:
        """The number of changes so far."""
        return self._change

    @property
    def ids(self) -> list[str]:
        """All ids, parents first."""
        return list(self.tags)

    @property
    def tags(self) -> Mapping[str, str]:
        """The tags of all nodes by their ids, parents first."""
        with self._lock:
            if self._tags is None:
                found, waiting = dict[str, str](), [self._root]
                while waiting:
                    node = waiting.pop()
                    found[node.id] = node.tag.name
                    waiting += reversed(node.children)
                self._tags = MappingProxyType(found)
            return self._tags

    def __contains__(self, name: object) -> bool:
        return name in self._nodes

    def __len__(self) -> int:
        return len(self._nodes)

    def node(self, name: str) -> Node:
        """What a node is now. Raises InnerModelError for an unknown id."""
        with self._lock:
            node = self._found(name)
            parent = node.parent.id if node.parent else ""
            children = tuple(each.id for each in node.children)
            return Node(name, node.tag.name, parent, children, MappingProxyType(dict(node.values)))

    def file(self, name: str, attribute: str = "file") -> Path | None:
        """The file that an attribute of a node names, relative to the file of the node; None if it does not exist."""
        with self._lock:
            node = self._found(name)
            document = node.element.document if node.element else self._model.documents[0] if self._model else None
            return found_file(str(node.values[attribute]), document.path.parent if document else Path(), self._prefixes)

    def parent(self, name: str) -> str:
        """The id of a node's parent; "" of the root."""
        with self._lock:
            above = self._found(name).parent
            return above.id if above else ""

    def place(self, name: str) -> Place | None:
        """Where the start tag of a node is; None if the node is not in a file."""
        with self._lock:
            element = self._found(name).element
            return element.place if element else None

    def differences(self, other: Tree) -> set[str]:
        """The ids of nodes that only one of the trees has, or that are not the same in both: in tag, parent, value,
        or position of a joint. Children of a node that differs may be the same."""
        with self._lock, other._lock:
            nodes, others = self._nodes, other._nodes
            names = other._touched if other._origin is self._state else nodes.keys() | others.keys()
            return {name for name in names if _differ(nodes.get(name), others.get(name))}

    # Where things are.

    def matrix(self, to: str, frame: str) -> Array:
        """The matrix that leads from `frame` to `to`, shape (4, 4): the inverse of `to`'s pose, times that of `frame`.

        Raises InnerModelError if there is no such node, as all methods do.
        """
        made = np.eye(4)
        made[:3] = np.array(self._matrix(to, frame)).reshape(3, 4)
        return made

    def offset(self, name: str) -> Array:
        """The pose of a joint that turns within its parent, at position 0, shape (4, 4)."""
        with self._lock:
            node = self._found(name)
            if self._drops_offsets and node.is_set:
                return np.eye(4)
            return axes.pose(three_of(node.values, "t"), axes.rotation(*three_of(node.values, "r")))

    def rotation(self, to: str, frame: str) -> Array:
        """Shape (3, 3)."""
        return self.matrix(to, frame)[:3, :3]

    def translation(self, to: str, frame: str) -> Array:
        """The origin of `frame`, seen from `to`: shape (3,), mm."""
        return self.matrix(to, frame)[:3, 3]

    def angles(self, to: str, frame: str) -> Array:
        """How `frame` is turned, seen from `to`: rx, ry, rz in rad, shape (3,); see `axes.angles`."""
        return axes.angles(self.rotation(to, frame))

    def transform(self, to: str, values: Sequence[float] | Array, frame: str) -> Array:
        """A point of `frame` (x, y, z), or a pose (x, y, z, rx, ry, rz), seen from `to`. Shape (3,) or (6,)."""
        a, b, c, u, d, e, f, v, g, h, i, w = self._matrix(to, frame)
        if len(values) == 3:
            x, y, z = values
            return np.array((a * x + b * y + c * z + u, d * x + e * y + f * z + v, g * x + h * y + i * z + w))
        if len(values) != 6:
            raise ValueError(f"a point has 3 numbers and a pose 6, not {len(values)}")
        x, y, z, *turn = values
        turned = np.array(((a, b, c), (d, e, f), (g, h, i))) @ axes.rotation(*turn)
        point = (a * x + b * y + c * z + u, d * x + e * y + f * z + v, g * x + h * y + i * z + w)
        return np.array((*point, *axes.angles(turned)))

    def transform_points(self, to: str, points: Array, frame: str) -> Array:
        """Many points of `frame`, shape (n, 3), seen from `to`. Shape (n, 3)."""
        matrix = np.array(self._matrix(to, frame)).reshape(3, 4)
        moved: Array = np.asarray(points, dtype=float) @ matrix[:, :3].T + matrix[:, 3]
        return moved

    def jacobian(self, joints: Sequence[str], frame: str, base: str, point: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
        """How a point of `frame` moves with joints, seen from `base`. Shape (6, len(joints)).

        The first three rows are its velocity, and the last three the angular velocity of `frame`, for a speed of 1 of
        each joint: in mm and rad, per rad of a joint that turns, per mm of one that slides. The column of a joint that
        moves neither or both of the two is zero.
        """
        with self._lock:
            frame_node, base_node = self._found(frame), self._found(base)
            above_frame, above_base = _lineage(frame_node), _lineage(base_node)
            from_base = axes.inverse(self._world(base_node)[0])
            tip = (self._world(frame_node)[0] @ (*point, 1.0))[:3]
            made = np.zeros((6, len(joints)))
            for column, name in enumerate(joints):
                joint = self._found(name)
                if joint.tag.name not in ("joint", "prismaticjoint"):
                    raise InnerModelError(f"`{name}` is a {joint.tag.name}, not a joint")
                if (joint in above_frame) == (joint in above_base):
                    continue
                sign = 1.0 if joint in above_frame else -1.0
                world = self._world(joint)[0]
                direction = sign * world[:3, "xyz".index(str(joint.values["axis"]))]
                if joint.tag.name == "joint":
                    made[:3, column] = axes.cross(direction, tip - world[:3, 3])
                    made[3:, column] = direction
                else:
                    made[:3, column] = direction
        turn = from_base[:3, :3]
        return np.vstack((turn @ made[:3], turn @ made[3:]))

    def project(self, camera: str, point: Sequence[float], frame: str = ROOT_ID) -> Array:
        """The pixel (column, row) at which a camera sees a point of `frame`. NaN if it is not before the camera."""
        return projected(self._lens(camera), self.transform(camera, point, frame))

    def back_project(self, camera: str, pixel: Sequence[float], depth: float, to: str = ROOT_ID) -> Array:
        """The point, seen from `to`, that a camera sees at (column, row) with a depth along its z in mm."""
        return self.transform(to, back_projected(self._lens(camera), pixel, depth), camera)

    def laser_to(self, laser: str, distance: float, angle: float, to: str = ROOT_ID) -> Array:
        """The point, seen from `to`, that a laser hits at a distance in mm, and an angle in rad to the right."""
        with self._lock:
            if self._found(laser).tag.name != "laser":
                raise InnerModelError(f"`{laser}` is no laser")
        return self.transform(to, laser_point(distance, angle), laser)

    def _lens(self, camera: str) -> Lens:
        with self._lock:
            node = self._found(camera)
            if "focal" not in node.values:
                raise InnerModelError(f"`{camera}` is a {node.tag.name}, not a camera")
            return Lens(*(number_of(node.values[name]) for name in ("width", "height", "focal")))

    # Moving things.

    def update_transform(self, name: str, pose: Sequence[float]) -> None:
        """Set the pose of a node within its parent: tx, ty, tz in mm, rx, ry, rz in rad. Of a joint, its offset."""
        if len(pose) != 6:
            raise ValueError(f"a pose has 6 numbers, not {len(pose)}")
        self._update(name, dict(zip(("tx", "ty", "tz", "rx", "ry", "rz"), pose, strict=True)))

    def update_translation(self, name: str, translation: Sequence[float]) -> None:
        """Set the translation of a node within its parent, mm."""
        if len(translation) != 3:
            raise ValueError(f"a translation has 3 numbers, not {len(translation)}")
        self._update(name, dict(zip(("tx", "ty", "tz"), translation, strict=True)))

    def update_rotation(self, name: str, angles: Sequence[float]) -> None:
        """Set the rotation of a node within its parent, rad."""
        if len(angles) != 3:
            raise ValueError(f"a rotation has 3 numbers, not {len(angles)}")
        self._update(name, dict(zip(("rx", "ry", "rz"), angles, strict=True)))

    def update_plane(self, name: str, normal: Sequence[float], point: Sequence[float]) -> None:
        """Set the normal of a plane, and its centre in mm."""
        if len(normal) != 3 or len(point) != 3:
            raise ValueError("a normal and a point have 3 numbers each")
        self._update(name, dict(zip(("nx", "ny", "nz", "px", "py", "pz"), (*normal, *point), strict=True)))

    def update_joint(self, name: str, angle: float) -> float:
        """Turn a joint to an angle in rad; returns the angle that it has then, between its limits."""
        return self._set_joint(name, angle, "joint")

    def update_prismatic(self, name: str, position: float) -> float:
        """Slide a joint to a position in mm; returns the position that it has then, between its limits."""
        return self._set_joint(name, position, "prismaticjoint")

    def position(self, name: str) -> float:
        """That of a joint: rad, or mm if it slides."""
        with self._lock:
            node = self._found(name)
            if "axis" not in node.values:
                raise InnerModelError(f"`{name}` is a {node.tag.name}, not a joint")
            return node.position

    def set_value(self, name: str, attribute: str, value: Value) -> None:
        """Set any attribute but the id, as the file would have it. Raises as `set_values` does."""
        self.set_values(name, {attribute: value})

    def set_values(self, name: str, values: Mapping[str, Value]) -> None:
        """Set some attributes. Raises InnerModelError for one that is not there, and for a value that no file can have;
        then none is set."""
        if "id" in values:
            raise InnerModelError("the id of a node cannot be changed")
        self._update(name, values)

    def _set_joint(self, name: str, position: float, kind: str) -> float:
        if not math.isfinite(position):
            raise ValueError(f"{position} is no position of a joint")
        with self._lock:
            node = self._found(name)
            if node.tag.name != kind:
                raise InnerModelError(f"`{name}` is a {node.tag.name}, not a {kind}")
            low, high = number_of(node.values["min"]), number_of(node.values["max"])
            node.position = min(max(float(position), low), high)
            node.is_set = True
            self._moved(node)
            return node.position

    def _update(self, name: str, values: Mapping[str, Value]) -> None:
        with self._lock:
            node = self._found(name)
            known = node.tag.attributes
            for attribute in values:
                if attribute not in known:
                    raise InnerModelError(f"`{name}`: {unknown(f'attribute of a {node.tag.name}', attribute, known)}")
            node.values = {**node.values, **{key: _plain(name, known[key], value) for key, value in values.items()}}
            self._moved(node)

    # Changing the tree.

    def add(self, parent: str, tag: str, name: str, **values: Value) -> None:
        """Add a node. Raises InnerModelError for a wrong tag, attribute or parent, and for an id that is taken."""
        with self._lock:
            above = self._found(parent)
            kind = TAGS.get(tag.lower())
            if kind is None or kind.name in (ROOT, INCLUDE):
                raise InnerModelError(unknown("tag", tag, [each for each in TAGS if each not in (ROOT, INCLUDE)]))
            if not above.tag.has_children:
                raise InnerModelError(f"`{parent}` is a {above.tag.name}, which has no children")
            if name in self._nodes:
                raise InnerModelError(f"there is a `{name}` already")
            if not name.strip() or not name.isprintable():
                raise InnerModelError(f"{name!r} is no id")
            node = _Node(kind, {key: each.default for key, each in kind.attributes.items()} | {"id": name})
            self._insert(node, above)
            try:
                self._update(name, values)
            except InnerModelError:
                self.remove(name)
                raise

    def remove(self, name: str) -> None:
        """Remove a node with all below it."""
        with self._lock:
            node = self._movable(name)
            assert node.parent is not None
            node.parent.children.remove(node)
            removed = [each.id for each in _every(node)]
            for each in removed:
                del self._nodes[each]
            self._tags = None
            self._changed(removed)

    def move(self, name: str, parent: str) -> None:
        """Put a node below another parent. It keeps its pose within its parent."""
        with self._lock:
            node, above = self._movable(name), self._found(parent)
            if not above.tag.has_children:
                raise InnerModelError(f"`{parent}` is a {above.tag.name}, which has no children")
            if node in _lineage(above):
                raise InnerModelError(f"`{parent}` is below `{name}`")
            assert node.parent is not None
            node.parent.children.remove(node)
            above.children.append(node)
            node.parent = above
            self._tags = None
            self._moved(node)

    def copy(self) -> Tree:
        """A tree of its own, which is the same now."""
        with self._lock:
            made = Tree(drops_offsets=self._drops_offsets)
            made._model, made.problems, made._prefixes = self._model, self.problems, self._prefixes
            made._change = self._change  # so that poses which are computed stay so
            made._tags, made._state, made._origin = self._tags, self._state, self._state
            for child in self._root.children:
                made._copy(child, made._root)
            return made

    def texts(self) -> dict[Path, bytes]:
        """The files of the tree as they are to be written, by their paths; only those that changed.

        Of a file, only what was changed differs. The positions of joints are not part of a file.
        """
        with self._lock:
            if self._model is None:
                raise InnerModelError("the tree was not read from a file; save it under a path")
            return written(self._model, self._written(self._root))

    def text(self) -> bytes:
        """The whole tree as one file of its own, in which files of meshes and textures have absolute paths."""
        with self._lock:
            made = self.copy()
            for node in _every(made._root):
                for attribute in ("file", "texture"):
                    path = made.file(node.id, attribute) if node.values.get(attribute) else None
                    if path is not None:
                        node.values = {**node.values, attribute: str(path.resolve())}
            return next(iter(written(None, made._written(made._root)).values()))

    def save(self, path: Path | str | None = None) -> None:
        """Write the tree: to the files that it was read from, or to one file.

        Raises InnerModelError if it would go to one file and an included file was changed, and OSError.
        """
        if path is None:
            for each, data in self.texts().items():
                each.write_bytes(data)
            return
        with self._lock:
            own = self._model.documents[0] if self._model else None
            found = written(self._model, self._written(self._root))
            others = [each for each in found if own is None or each != own.path]
            if own and others:
                raise InnerModelError(f"{others[0]} is an included file, and was changed: save it without a path")
            data = found[own.path] if own and own.path in found else own.data if own else next(iter(found.values()))
        Path(path).write_bytes(data)

    def _adopt(self, element: Element, parent: _Node) -> None:
        node = _Node(element.tag, dict(element.values), element)
        self._insert(node, parent)
        for child in element.children:
            self._adopt(child, node)

    def _copy(self, node: _Node, parent: _Node) -> None:
        made = _Node.__new__(_Node)
        made.tag, made.values, made.element, made.id = node.tag, node.values, node.element, node.id
        made.position, made.is_set, made.local = node.position, node.is_set, node.local
        made.stamp, made.world, made.latest = node.stamp, node.world, node.latest
        made.parent, made.children = parent, []
        parent.children.append(made)
        self._nodes[made.id] = made
        for child in node.children:
            self._copy(child, made)

    def _insert(self, node: _Node, parent: _Node) -> None:
        node.parent = parent
        parent.children.append(node)
        self._nodes[node.id] = node
        self._tags = None
        self._moved(node)

    def _written(self, node: _Node) -> Written:
        return Written(node.tag, node.values, node.element, [self._written(each) for each in node.children])

    def _movable(self, name: str) -> _Node:
        node = self._found(name)
        if node is self._root:
            raise InnerModelError(f"`{ROOT_ID}` stays")
        return node

    def _found(self, name: str) -> _Node:
        try:
            return self._nodes[name]
        except KeyError:
            raise InnerModelError(unknown("node", name, self._nodes)) from None

    # Matrices, each computed when it is asked for. Callers hold the lock.

    def _matrix(self, to: str, frame: str) -> tuple[float, ...]:
        """The first three rows, as numbers: Python is faster with them than numpy is with small arrays."""
        found = self._matrices.get((to, frame))
        if found is not None:
            return found
        with self._lock:
            node, other = self._found(frame), self._found(to)
            moved = axes.inverse(self._world(other)[0]) @ self._world(node)[0]
            found = tuple(moved[:3].ravel().tolist())
            if len(self._matrices) >= _MOST_CACHED:
                self._matrices = {}
            self._matrices[to, frame] = found
            return found

    def _world(self, node: _Node) -> tuple[Array, int]:
        """The pose of a node, and the last change of it or of a node above it."""
        if node.parent is None:
            return node.world, node.stamp
        above, latest = self._world(node.parent)
        latest = max(latest, node.stamp)
        if node.latest != latest:
            node.world, node.latest = above @ node.local, latest
        return node.world, latest

    def _moved(self, node: _Node) -> None:
        node.local = _local(node, self._drops_offsets)
        self._changed((node.id,))
        node.stamp = self._change

    def _changed(self, names: Iterable[str]) -> None:
        self._change += 1
        self._state = object()
        self._touched.update(names)
        if len(self._touched) > len(self._nodes):  # they may be those of nodes that are long gone
            self._origin, self._touched = object(), set()
        self._matrices = {}  # a new one: a thread may just be reading the old one


def _differ(one: _Node | None, other: _Node | None) -> bool:
    """Whether two nodes of the same id are not the same; None: a tree does not have it."""
    if one is None or other is None:
        return one is not other
    return (
        (one.values is not other.values and one.values != other.values)
        or one.tag is not other.tag
        or (one.position, one.is_set) != (other.position, other.is_set)
        or (one.parent and one.parent.id) != (other.parent and other.parent.id)
    )


def _local(node: _Node, drops_offsets: bool) -> Array:
    """The pose of a node within its parent."""
    values = node.values
    if node.tag.name in ("plane", "display"):
        return axes.pose(three_of(values, "p"), axes.along_normal(three_of(values, "n")))
    made = axes.pose(three_of(values, "t"), axes.rotation(*three_of(values, "r")))
    if node.tag.name == "joint":
        turned = axes.pose((0.0, 0.0, 0.0), axes.about(str(values["axis"]), node.position))
        return turned if drops_offsets and node.is_set else made @ turned
    if node.tag.name == "prismaticjoint":
        slide = node.position + number_of(values["offset"])
        return axes.pose([slide if each == values["axis"] else 0.0 for each in "xyz"], np.eye(3))
    return made


def _plain(node: str, attribute: Attribute, value: Value) -> Value:
    """The value of an attribute as a file would give it; numbers of numpy become those of Python.

    Raises InnerModelError for a value that no file can have.
    """
    made: Value
    if isinstance(value, (list, tuple, np.ndarray)):
        made = tuple(each.item() if isinstance(each, np.generic) else each for each in value)
    else:
        made = value.item() if isinstance(value, np.generic) else value
    if wrong := amiss(attribute, made, as_text(made)):
        raise InnerModelError(f"`{node}`: `{attribute.name}` {wrong}")
    return int(made) if attribute.kind is Kind.COUNT and isinstance(made, float) else made


def _every(node: _Node) -> Iterator[_Node]:
    """A node and all below it, parents first."""
    waiting = [node]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += reversed(node.children)


def _lineage(node: _Node) -> set[_Node]:
    """A node and all above it."""
    found = {node}
    while node.parent:
        node = node.parent
        found.add(node)
    return found
