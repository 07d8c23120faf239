"""Pages that only show: of a scene's file, and what is common to them and to those of a running scene."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ...errors import RobocompError
from ...innermodel import axes
from ...innermodel.axes import Array
from ...innermodel.nodes import TAGS
from ...innermodel.read import ROOT_ID, InnerModelError, read_file
from ...innermodel.tree import Tree
from ...innermodel.write import as_text
from .page import Page
from .shapes import Cloud, Gallery, drawn, on_page, stamp
from .stage import Picked, Stage

if TYPE_CHECKING:
    import viser  # loaded by `page`, which says what to install if it is not there

Tell = Callable[[str], None]
"""Gets a line for people."""

_NOTHING = "Click something."
_COVERED = 0.3
"""The part of the height of a narrow page that the panel covers."""


class Scene:
    """Trees on a page, of which what cannot be shown is told once."""

    def __init__(self, server: viser.ViserServer, tell: Tell, picked: Picked) -> None:
        self._tell, self._told = tell, set[str]()
        self._gallery = Gallery()
        self._stage = Stage(server, self._gallery, picked)

    def show(
        self, tree: Tree, carriers: Collection[str] = (), clouds: Mapping[str, Cloud] = MappingProxyType({})
    ) -> None:
        """Show a tree, with the points of its clouds. What is at or below `carriers` is moved by `place`."""
        drawing = drawn(tree, self._gallery, carriers, clouds)
        for each in drawing.troubles:
            if each not in self._told:
                self._told.add(each)
                self._tell(each)
        self._stage.show(drawing.shapes)

    def aim(self, client: viser.ClientHandle, covered: float) -> None:
        """Let a new page look at all of it; `covered` is the part of a narrow page that the panel covers."""
        self._stage.aim(client.camera, covered)

    def place(self, matrices: Mapping[str, Array]) -> None:
        """Move carriers to where poses of InnerModel say, seen from the root."""
        self._stage.place({name: on_page(matrix) for name, matrix in matrices.items()})


class Show:
    """A tree on a page, with what a click tells of a node."""

    def __init__(self, page: Page, tell: Tell) -> None:
        self._tell = tell
        self.scene = Scene(page.server, tell, self._picked)
        self._facts: dict[int, Any] = {}
        """What pages show of a node, by their numbers."""
        self._picks: dict[int, str] = {}
        """The nodes that pages show, by the numbers of the pages."""
        self.tree = Tree()
        page.server.on_client_connect(self._opened)
        page.server.on_client_disconnect(self._left)

    @property
    def is_seen(self) -> bool:
        """Whether a page is open."""
        return bool(self._facts)

    def show(
        self, tree: Tree, carriers: Collection[str] = (), clouds: Mapping[str, Cloud] = MappingProxyType({})
    ) -> None:
        """Show a tree, with the points of its clouds. What is at or below `carriers` is moved by `scene.place`."""
        self.tree = tree
        self.scene.show(tree, carriers, clouds)

    def where(self, node: str) -> Array:
        """The pose of a node, seen from the root."""
        return self.tree.matrix(ROOT_ID, node)

    def place(self, node: str) -> str:
        """The place of a node in its file; "" if it has none."""
        return str(self.tree.place(node) or "")

    async def _opened(self, client: viser.ClientHandle) -> None:
        self.scene.aim(client, _COVERED)
        self._facts[client.client_id] = client.gui.add_text("node", _NOTHING, multiline=True, disabled=True)

    async def _left(self, client: viser.ClientHandle) -> None:
        self._facts.pop(client.client_id, None)
        self._picks.pop(client.client_id, None)

    def tell_again(self) -> None:
        """Tell pages of the nodes that they show, which may have moved."""
        for client, node in list(self._picks.items()):
            self._picked(node, client)

    def _picked(self, node: str, client: int) -> None:
        text = self._facts.get(client)
        if text is None or node not in self.tree:
            return
        self._picks[client] = node
        try:
            text.value = facts(self.tree, node, self.where(node), self.place(node))
        except RobocompError as exc:  # a component that runs no longer
            text.value = str(exc)


class FileShow(Show):
    """A file on a page. It is read again when it, or a file that it includes, has changed."""

    def __init__(self, page: Page, path: Path, tell: Tell) -> None:
        """Raises InnerModelError if the file is wrong."""
        super().__init__(page, tell)
        self._path = path
        self._stamps: dict[Path, int] = {}
        self.show(self._read())

    def follow(self, is_ended: threading.Event, every: float = 0.5) -> None:
        """Read changes until the event is set."""
        while not is_ended.wait(every):
            self.look()

    def look(self) -> None:
        """Read the file again if it has changed. What is wrong then is told, and nothing else changes."""
        if self._stamps == {each: stamp(each) for each in self._stamps}:
            return
        try:
            self.show(self._read())
        except InnerModelError as exc:
            self._tell(str(exc))

    def _read(self) -> Tree:
        stamps: dict[Path, int] = {self._path: stamp(self._path)}

        def reading(path: Path) -> bytes:
            stamps[path] = stamp(path)
            return read_file(path)

        self._stamps = stamps
        return Tree.read(self._path, reading=reading)


def facts(tree: Tree, name: str, pose: Array, place: str) -> str:
    """What a node is, in lines for people. `place` is that in its file, or ""."""
    node = tree.node(name)
    turn = axes.angles(pose[:3, :3])
    lines = [f"{node.tag} {name}", place, f"in {node.parent}" if node.parent else ""]
    lines.append("at " + ", ".join(f"{round(each)}" for each in pose[:3, 3]) + " mm")
    lines.append("turned " + ", ".join(f"{round(each, 3) + 0.0:.3f}" for each in turn) + " rad")
    known = TAGS[node.tag].attributes
    lines += [
        f"{key} = {as_text(value)}" for key, value in node.values.items() if key != "id" and value != known[key].default
    ]
    return "\n".join(each for each in lines if each)
