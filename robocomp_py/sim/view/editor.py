"""A scene's file that is edited: what is selected, changes, undo and redo, and saving. Knows nothing of a page.

    editor = Editor(Path("house.xml"), write)
    editor.set("board", "texture", "#886644")
    editor.save()

Only what was edited changes in the file. Lengths are in mm, angles in rad.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from ...errors import RobocompError
from ...innermodel import axes
from ...innermodel.axes import Array
from ...innermodel.mesh import read_mesh
from ...innermodel.nodes import TAGS, Value
from ...innermodel.read import ROOT_ID, InnerModelError, found_file, number_of, read, read_file
from ...innermodel.tree import Node, Tree

Write = Callable[[Path, bytes], None]
"""Replaces a file. Raises OSError."""

_MOST_STEPS = 200
"""That can be undone."""

_LENGTHS, _ANGLES = 1, 4
"""Decimals of what a gizmo gives: 0.1 mm and 0.0001 rad."""

_PLANES = ("plane", "display")


class EditorError(RobocompError):
    """What is asked cannot be done; nothing has changed."""


class Editor:
    """One thread uses it at a time."""

    def __init__(self, path: Path, write: Write) -> None:
        """Raises InnerModelError if the file is wrong."""
        self.path, self._write = path, write
        self.selected = ""
        """The id of a node, or ""."""
        self.load()

    def load(self) -> None:
        """Read the file again; all edits are dropped. Raises InnerModelError, and keeps what it has then."""
        data: dict[Path, bytes] = {}

        def reading(path: Path) -> bytes:
            data[path] = read_file(path)
            return data[path]

        self.tree = Tree.read(self.path, reading=reading)
        """The scene with all edits. It is not to be changed: each edit makes another one."""
        self._read, self._disk = data, dict(data)
        self._before: list[Tree] = []
        self._after: list[Tree] = []
        self._open: tuple[str, str] | None = None
        """The node and the attribute of the last step, if more changes of it are the same step."""
        self._reselect()

    @property
    def can_undo(self) -> bool:
        return bool(self._before)

    @property
    def can_redo(self) -> bool:
        return bool(self._after)

    @property
    def is_saved(self) -> bool:
        """Whether the file is as the scene is."""
        return not self._unsaved()

    def select(self, name: str) -> None:
        """Select a node; "": none."""
        self.selected = name if name in self.tree else ""
        self._open = None

    # Changes.

    def set(self, name: str, attribute: str, text: str) -> None:
        """Set an attribute to what a file would have. Changes of the same one in a row are one step.

        Raises EditorError for a text that is no value of it.
        """
        node = self._node(name)
        value = parsed(node.tag, attribute, text)
        if value != node.values[attribute]:
            with self._step((name, attribute)):
                self.tree.set_value(name, attribute, value)

    def place(self, name: str, pose: Array) -> None:
        """Put a node where a pose says that is seen from the root, shape (4, 4).

        It is rounded to 0.1 mm and 0.0001 rad, and what stays within that is not changed. Moves in a row are one step.
        """
        node = self._node(name)
        local = axes.inverse(self.tree.matrix(ROOT_ID, node.parent)) @ pose if node.parent else pose
        if node.tag == "joint":  # its pose includes its turn, which is no part of its file
            turn = axes.about(str(node.values["axis"]), self.tree.position(name))
            local = local @ axes.pose((0.0, 0.0, 0.0), turn.T)
        changes = moved(node, local)
        if changes:
            with self._step((name, "pose")):
                for attribute, value in changes.items():
                    self.tree.set_value(name, attribute, value)

    def settle(self) -> None:
        """The next change is another step."""
        self._open = None

    def add_plane(self) -> str:
        """Add a box in what is selected, or beside it; returns its id."""
        return self._add("plane", {"size": (500.0, 500.0, 500.0), "py": 250.0, "texture": "#b0a080"})

    def finds(self, file: str) -> bool:
        """Whether there is such a file: an absolute path, or one from the folder of the scene."""
        return found_file(file, self.path.parent, {}) is not None

    def add_mesh(self, file: str) -> str:
        """Add a shape from a file, and return its id. Raises EditorError if the file cannot be read."""
        alone = self.tree.copy()
        name = _free(alone, "mesh")
        try:
            alone.add(ROOT_ID, "mesh", name, file=file)
            path = alone.file(name)
            if path is None:
                raise EditorError(f"there is no file `{file}`; paths are from the folder of the scene")
            read_mesh(path)
        except InnerModelError as exc:
            raise EditorError(str(exc)) from exc
        return self._add("mesh", {"file": file})

    def remove(self, name: str) -> None:
        """Remove a node with all below it, and select its parent."""
        node = self._node(name)
        if name == ROOT_ID:
            raise EditorError("the root stays")
        with self._step(None):
            self.tree.remove(name)
        self.select(node.parent if node.parent != ROOT_ID else "")

    def undo(self) -> None:
        """Go back before the last step, if there is one."""
        if self._before:
            self._after.append(self.tree)
            self.tree = self._before.pop()
            self._reselect()

    def redo(self) -> None:
        """Do again what was undone last."""
        if self._after:
            self._before.append(self.tree)
            self.tree = self._after.pop()
            self._reselect()

    # The disk.

    def save(self) -> list[Path]:
        """Write what was edited, and return the files that were written.

        Raises EditorError if a file of the scene was changed by something else, or cannot be written.
        """
        if stale := self.stale():
            raise EditorError(
                f"{stale[0]} was changed on disk after it was read: nothing is written. "
                "Reload the file, which drops the edits, or save a copy"
            )
        unsaved = self._unsaved()
        for path, data in unsaved.items():
            try:
                self._write(path, data)
            except OSError as exc:
                raise _unwritten(path, exc) from exc
            self._disk[path] = data
        self._open = None
        return list(unsaved)

    def save_copy(self) -> Path:
        """Write the scene beside its file, under a name that is free. Raises EditorError."""
        found = self.tree.texts()
        if others := [each for each in found if each != self.path]:
            raise EditorError(f"{others[0]} is an included file, and was edited: a copy of {self.path} has no use")
        number = 2
        while (path := self.path.with_stem(f"{self.path.stem}-{number}")).exists():
            number += 1
        data = found.get(self.path, self._read[self.path])
        try:
            with path.open("xb") as file:
                file.write(data)
        except OSError as exc:
            raise _unwritten(path, exc) from exc
        return path

    @property
    def files(self) -> list[Path]:
        """The files of the scene."""
        return list(self._disk)

    def stale(self) -> list[Path]:
        """The files of the scene that are no longer as they were read or saved."""
        return [path for path, data in self._disk.items() if _on_disk(path) != data]

    def _unsaved(self) -> dict[Path, bytes]:
        """The files that differ from the disk, as they are to be written."""
        changed = self.tree.texts()
        wanted = {path: changed.get(path, data) for path, data in self._read.items()}
        return {path: data for path, data in wanted.items() if data != self._disk[path]}

    # How it is done.

    def _node(self, name: str) -> Node:
        try:
            return self.tree.node(name)
        except InnerModelError as exc:
            raise EditorError(str(exc)) from exc

    @contextmanager
    def _step(self, key: tuple[str, str] | None) -> Iterator[None]:
        """A change of the tree: a step of its own, or a part of the last one if that has the same key."""
        before = self.tree
        is_new = key is None or key != self._open
        if is_new:
            self.tree = before.copy()
        try:
            yield
        except InnerModelError as exc:
            self.tree = before
            raise EditorError(str(exc)) from exc
        if is_new:
            self._before = [*self._before, before][-_MOST_STEPS:]
        self._after.clear()
        self._open = key

    def _add(self, tag: str, values: Mapping[str, Value]) -> str:
        above = self.selected or ("world" if "world" in self.tree else ROOT_ID)
        while not TAGS[self.tree.node(above).tag].has_children:
            above = self.tree.parent(above)
        name = _free(self.tree, tag)
        with self._step(None):
            self.tree.add(above, tag, name, **values)
        self.select(name)
        return name

    def _reselect(self) -> None:
        """After another tree has become the present one."""
        self._open = None
        if self.selected not in self.tree:
            self.selected = ""


def parsed(tag: str, attribute: str, text: str) -> Value:
    """The value that a file would have. Raises EditorError."""
    line = f"<innerModel><{tag} id='x' {attribute}={quoteattr(text)}/></innerModel>"
    model = read(Path("field"), reading=lambda path: line.encode())
    known = [each for each in model.problems if each.code != "without-effect"]
    if known:
        raise EditorError(f"{known[0].message}{f'; {known[0].hint}' if known[0].hint else ''}")
    return model.elements[0].values[attribute]


def gives(node: Node) -> tuple[bool, bool]:
    """Whether a node can be moved, and whether it can be turned, by its attributes."""
    if node.tag in _PLANES:
        return True, True
    return "tx" in node.values, "rx" in node.values


def moved(node: Node, local: Array) -> dict[str, float]:
    """The attributes that change if a node has this pose within its parent; of a joint, without its turn."""
    is_plane = node.tag in _PLANES
    moves, turns = gives(node)
    found: dict[str, float] = {}
    if moves:
        names = ("px", "py", "pz") if is_plane else ("tx", "ty", "tz")
        found |= _rounded(node, dict(zip(names, local[:3, 3].tolist(), strict=True)), _LENGTHS)
    if not turns:
        return found
    names = ("nx", "ny", "nz") if is_plane else ("rx", "ry", "rz")
    told = [number_of(node.values[each]) for each in names]
    before = axes.along_normal(told) if is_plane else axes.rotation(*told)
    near = 0.5 * 10**-_ANGLES
    if is_plane:
        if not np.allclose(before[:, 2], local[:3, 2], rtol=0.0, atol=near):  # a turn about the normal has no effect
            found |= _rounded(node, dict(zip(names, (-local[:3, 2]).tolist(), strict=True)), _ANGLES)
    elif not np.allclose(before, local[:3, :3], rtol=0.0, atol=near):
        angles = axes.angles(local[:3, :3]).tolist()
        found |= _rounded(node, dict(zip(names, angles, strict=True)), _ANGLES)
    return found


def _rounded(node: Node, wanted: Mapping[str, float], decimals: int) -> dict[str, float]:
    """What differs from what a node has by more than is rounded away."""
    near = 0.5 * 10**-decimals + 1e-9
    return {
        name: round(value, decimals) + 0.0
        for name, value in wanted.items()
        if abs(value - number_of(node.values[name])) > near
    }


def _free(tree: Tree, beginning: str) -> str:
    """An id that no node has."""
    number = 1
    while f"{beginning}{number}" in tree:
        number += 1
    return f"{beginning}{number}"


def _unwritten(path: Path, error: OSError) -> EditorError:
    return EditorError(f"{path} cannot be written: {error.strerror or error}")


def _on_disk(path: Path) -> bytes | None:
    try:
        return read_file(path)
    except OSError:
        return None
