"""The editor on pages: one of them edits, the others look. All runs on the thread of viser's event loop."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import viser.transforms

from ...innermodel import axes
from ...innermodel.nodes import CHOICES, TAGS, Attribute, Kind
from ...innermodel.read import ROOT_ID, InnerModelError
from ...innermodel.write import as_text
from .editor import Editor, EditorError, gives
from .page import Page
from .shapes import from_page, on_page, stamp
from .stage import quaternion
from .viewing import Scene, Tell, facts

if TYPE_CHECKING:
    from viser import ClientHandle, GuiEvent, TransformControlsEvent

_NONE = "(none)"
_LOOK = 0.5
"""Seconds between two looks at whether the file was changed by something else."""
_GIZMO = "/gizmo"
_GIZMO_SIZE = 110.0
"""Length of its arrows, pixels: the same from near and from far."""
_COVERED = 0.6
"""The part of the height of a narrow page that the panel covers."""
_SHOWN_IDS = 5000
"""Nodes that can be chosen from the list; of a larger scene, others are selected by a click."""


class Desk:
    """An editor and its pages. The first page that is opened edits; if it is closed, the next one does."""

    def __init__(self, page: Page, editor: Editor, tell: Tell) -> None:
        self.editor, self._tell = editor, tell
        self._server = page.server
        page.dock()
        self._scene = Scene(page.server, tell, self._clicked)
        self._sheet: Sheet | None = None
        self._lookers: dict[int, Any] = {}
        """What pages that only look show of a node, by their numbers."""
        self._stamps = self._stamped()
        self.draw()
        page.server.on_client_connect(self._opened)
        page.server.on_client_disconnect(self._left)

    def follow(self, is_ended: threading.Event, every: float = _LOOK) -> None:
        """Notice changes of the file by something else, until the event is set."""
        loop = self._server.get_event_loop()
        while not is_ended.wait(every):
            loop.call_soon_threadsafe(self._look)

    def draw(self) -> None:
        """Show the scene as it is now."""
        self._scene.show(self.editor.tree)

    async def _opened(self, client: ClientHandle) -> None:
        self._scene.aim(client, _COVERED)
        if self._sheet is None:
            self._sheet = Sheet(client, self)
            return
        client.gui.add_text("state", "read only: another page edits this scene", disabled=True)
        self._lookers[client.client_id] = client.gui.add_text("node", "Click something.", multiline=True, disabled=True)

    async def _left(self, client: ClientHandle) -> None:
        self._lookers.pop(client.client_id, None)
        if self._sheet is None or self._sheet.client.client_id != client.client_id:
            return
        self._sheet = None
        clients = self._server.get_clients()
        for number in sorted(set(self._lookers) & set(clients)):
            del self._lookers[number]
            clients[number].gui.reset()
            self._sheet = Sheet(clients[number], self)
            return

    async def _clicked(self, node: str, number: int) -> None:
        if self._sheet is not None and self._sheet.client.client_id == number:
            self._sheet.select(node)
        elif number in self._lookers and node in self.editor.tree:
            tree = self.editor.tree
            self._lookers[number].value = facts(tree, node, tree.matrix(ROOT_ID, node), str(tree.place(node) or ""))

    def _look(self) -> None:
        stamps = self._stamped()
        if stamps == self._stamps:
            return
        self._stamps = stamps
        stale = self.editor.stale()
        if not stale:
            return
        if self.editor.is_saved:
            text = self.load()
        else:
            text = f"{stale[0]} was changed on disk: it cannot be saved over that. Reload it, or save a copy"
        self._tell(text)
        if self._sheet:
            self._sheet.refresh(text)

    def load(self) -> str:
        """Read the file again; returns what has happened, for people."""
        try:
            self.editor.load()
        except InnerModelError as exc:
            return f"not read again: {exc}"
        self._stamps = self._stamped()
        self.draw()
        return f"{self.editor.path.name}: read again"

    def _stamped(self) -> dict[Path, int]:
        return {path: stamp(path) for path in self.editor.files}


class Sheet:
    """The fields and the gizmo of the page that edits."""

    def __init__(self, client: ClientHandle, desk: Desk) -> None:
        self.client, self._desk, self._editor = client, desk, desk.editor
        gui = client.gui
        self._state: Any = gui.add_text("state", "", multiline=True, disabled=True)
        self._ids: tuple[str, ...] = ()
        self._node: Any = gui.add_dropdown("node", (_NONE,))
        self._node.on_update(self._chosen)
        self._place = gui.add_folder(None)
        """Where the folder of fields is."""
        self._undo = self._button("Undo", self._editor.undo)
        self._redo = self._button("Redo", self._editor.redo)
        self._save = self._button("Save", self._saved)
        with gui.add_folder("node and scene"):
            self._parent = self._button("Select parent", self._select_parent)
            self._remove = self._button("Remove", lambda: self._editor.remove(self._editor.selected))
            self._button("Add plane", self._editor.add_plane, tells=False)
            self._file: Any = gui.add_text("mesh file", "", hint="a file, absolute or from the folder of the scene")
            self._file.on_update(self._named)
            self._mesh = self._button("Add mesh", lambda: self._editor.add_mesh(self._file.value.strip()), tells=False)
        with gui.add_folder("file"):
            self._button("Save a copy", lambda: f"saved as {self._editor.save_copy().name}")
            self._button("Reload", self._desk.load)
        self._folder: Any = None
        self._fields: dict[str, Any] = {}
        """By the names of attributes."""
        self._gizmo: Any = None
        self._shown = _NONE
        """The node whose fields are shown."""
        self.refresh()

    def select(self, node: str) -> None:
        """Select a node, and show its fields."""
        self._editor.select(node)
        self.refresh()

    def refresh(self, text: str = "", *, except_field: str = "") -> None:
        """Show everything as it is now, with a text about what has happened; a field that is being typed in stays."""
        editor = self._editor
        ids = (_NONE, *editor.tree.ids[1:_SHOWN_IDS])
        if ids != self._ids:
            self._ids = self._node.options = ids
        chosen = editor.selected or _NONE
        if self._node.value != chosen and chosen in ids:
            self._node.value = chosen
        if chosen != self._shown:
            self._show_fields()
        for name, field in self._fields.items():
            value = _as_field(TAGS[editor.tree.node(editor.selected).tag].attributes[name], self._value(name))
            if name != except_field and field.value != value:
                field.value = value
        self._place_gizmo()
        is_saved = editor.is_saved
        self._undo.disabled, self._redo.disabled = not editor.can_undo, not editor.can_redo
        self._save.disabled = is_saved
        self._mesh.disabled = not editor.finds(self._file.value.strip())
        self._remove.disabled = self._parent.disabled = not editor.selected
        self._state.value = text or f"{editor.path.name}: {'saved' if is_saved else 'not saved'}"

    def _button(self, label: str, act: Callable[[], object], *, tells: bool = True) -> Any:
        """A button; if `tells`, the text that the action returns is shown."""
        button = self.client.gui.add_button(label)

        async def pressed(_: object) -> None:
            try:
                said = act()
            except EditorError as exc:
                self.refresh(str(exc))
                return
            self._desk.draw()
            self.refresh(said if tells and isinstance(said, str) else "")

        button.on_click(pressed)
        return button

    def _saved(self) -> str:
        names = ", ".join(each.name for each in self._editor.save())
        return f"{names}: saved" if names else ""

    def _select_parent(self) -> None:
        parent = self._editor.tree.parent(self._editor.selected)
        self._editor.select(parent if parent != ROOT_ID else "")

    async def _chosen(self, event: GuiEvent[Any]) -> None:
        if event.client is not None:  # else this program has set it
            self.select("" if event.target.value == _NONE else event.target.value)

    async def _named(self, event: GuiEvent[Any]) -> None:
        self._mesh.disabled = not self._editor.finds(event.target.value.strip())

    # Fields.

    def _show_fields(self) -> None:
        editor = self._editor
        self._shown = editor.selected or _NONE
        if self._folder is not None:
            self._folder.remove()
        self._folder, self._fields = None, {}
        if not editor.selected:
            return
        tag = TAGS[editor.tree.node(editor.selected).tag]
        with self._place:
            self._folder = self.client.gui.add_folder(f"{tag.name} {editor.selected}")
        with self._folder:
            for name, attribute in tag.attributes.items():
                if name != "id" and not attribute.text.startswith("without effect"):
                    self._fields[name] = self._field(name, attribute)

    def _field(self, name: str, attribute: Attribute) -> Any:
        gui, value = self.client.gui, _as_field(attribute, self._value(name))
        field: Any
        if attribute.kind is Kind.FLAG:
            field = gui.add_checkbox(name, value, hint=attribute.text)
        elif attribute.kind in CHOICES:
            field = gui.add_dropdown(name, CHOICES[attribute.kind], initial_value=value, hint=attribute.text)
        else:
            field = gui.add_text(name, value, hint=attribute.text)
        node = self._editor.selected

        async def typed(event: GuiEvent[Any]) -> None:
            if event.client is None or node not in self._editor.tree:
                return
            told = event.target.value
            try:
                self._editor.set(node, name, as_text(told))
            except EditorError as exc:
                self.refresh(str(exc), except_field=name)
                return
            self._desk.draw()
            self.refresh(except_field=name)

        field.on_update(typed)
        return field

    def _value(self, name: str) -> Any:
        return self._editor.tree.node(self._editor.selected).values[name]

    # The gizmo.

    def _place_gizmo(self) -> None:
        tree, name = self._editor.tree, self._editor.selected
        moves, turns = gives(tree.node(name)) if name else (False, False)
        kind = (moves, turns)
        if self._gizmo is not None and self._gizmo[0] != kind:
            self._gizmo[1].remove()
            self._gizmo = None
        if not (moves or turns):
            return
        pose = on_page(tree.matrix(ROOT_ID, name))
        turn = quaternion(pose[:3, :3])
        if self._gizmo is None:
            made = self.client.scene.add_transform_controls(
                _GIZMO,
                scale=_GIZMO_SIZE,
                fixed=True,
                disable_axes=not moves,
                disable_sliders=not moves,
                disable_rotations=not turns,
                depth_test=False,
                position=pose[:3, 3].copy(),
                wxyz=turn,
            )
            made.on_update(self._dragged)
            self._gizmo = kind, made
            return
        self._gizmo[1].position, self._gizmo[1].wxyz = pose[:3, 3].copy(), turn

    async def _dragged(self, event: TransformControlsEvent) -> None:
        name = self._editor.selected
        if not name or event.phase == "start":
            return
        turn = viser.transforms.SO3(np.array(event.target.wxyz)).as_matrix().astype(float)
        pose = from_page(axes.pose(np.array(event.target.position).tolist(), turn))
        text = ""
        try:
            self._editor.place(name, pose)
        except EditorError as exc:
            text = str(exc)
        self._desk.draw()
        if event.phase == "end":
            self._editor.settle()
            self.refresh(text)


def _as_field(attribute: Attribute, value: Any) -> Any:
    """A value as its field shows it."""
    if attribute.kind is Kind.FLAG:
        return bool(value)
    return as_text(value)
