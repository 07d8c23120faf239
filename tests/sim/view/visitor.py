"""A program that visits a page as a browser does, and sees what it is sent."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
import viser
import viser.transforms
import zstandard
from viser import _messages as messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from robocomp_py.innermodel.axes import Array
from robocomp_py.testing.patience import SOON, wait_until


class Visitor:
    """What a page has on it: objects of the scene by their names, and fields by their labels."""

    def __init__(self, connection: ClientConnection, size: tuple[int, int]) -> None:
        self._connection = connection
        self._lock = threading.Lock()
        self.scene: dict[str, dict[str, Any]] = {}
        self.fields: dict[str, dict[str, Any]] = {}
        """By their numbers."""
        self.notes: list[str] = []
        """What was told by notifications."""
        self._thread = threading.Thread(target=self._hear, name="visitor")
        self._thread.start()
        self.look((0, 0, 5), size)

    def close(self) -> None:
        self._connection.close()
        self._thread.join()

    def shown(self, kind: str) -> list[dict[str, Any]]:
        """The objects of this kind, such as `Box`, with `where`, their poses seen from the root."""
        with self._lock:
            found = [name for name, each in self.scene.items() if each["type"] == f"{kind}Message"]
            return [{**self.scene[name], "where": self._where(name)} for name in found]

    def field(self, label: str) -> Any:
        """The properties of a field or button; {} if there is none that is visible."""
        with self._lock:
            fitting = [each for each in self.fields.values() if each["label"] == label and each["visible"]]
            return dict(fitting[-1]) if fitting else {}

    def value(self, label: str) -> Any:
        return self.field(label).get("value")

    def look(self, place: tuple[float, float, float], size: tuple[int, int]) -> None:
        """Look from a place, in a window of this width and height."""
        width, height = size
        self._send(
            messages.ViewerCameraMessage(
                (1, 0, 0, 0), place, 1.3, 0.1, 100, height, width, look_at=(0, 0, 0), up_direction=(0, 0, 1)
            )
        )

    def click(self, name: str) -> None:
        """Click an object of the scene."""
        self._send(
            messages.SceneNodeClickMessage(name, None, (0, 0, 5), (0, 0, -1), (0.5, 0.5), None, self._owner(name))
        )

    def set(self, label: str, value: Any) -> None:
        """Set a field, or press a button by True, once it is there."""
        wait_until(lambda: self.field(label), what=f"no field `{label}`")
        number = self.field(label)["uuid"]
        with self._lock:
            self.fields[number]["value"] = value
        self._send(messages.GuiUpdateMessage(number, {"value": value}))

    def drag(self, matrix: Array) -> None:
        """Move the gizmo to a pose within its parent."""
        wait_until(lambda: self.shown("TransformControls"), what="no gizmo")
        name = self.shown("TransformControls")[-1]["name"]
        turn = tuple(map(float, viser.transforms.SO3.from_matrix(matrix[:3, :3]).wxyz))
        owner, place = self._owner(name), tuple(map(float, matrix[:3, 3]))
        self._send(messages.TransformControlsDragStartMessage(name, owner))
        self._send(messages.TransformControlsUpdateMessage(name, turn, place, owner))  # type: ignore[arg-type]
        self._send(messages.TransformControlsDragEndMessage(name, owner))

    def awaits(self, condition: Callable[[], object]) -> None:
        wait_until(condition)

    def _owner(self, name: str) -> str:
        return str(self.scene[name].get("owner", ""))

    def _where(self, name: str) -> Array:
        made = np.eye(4)
        while name:
            own = self.scene.get(name, {})
            within = np.eye(4)
            within[:3, :3] = viser.transforms.SO3(np.array(own.get("wxyz", (1, 0, 0, 0)))).as_matrix()
            within[:3, 3] = own.get("position", (0, 0, 0))
            made = within @ made
            name = name.rpartition("/")[0]
        return made

    def _send(self, message: messages.Message) -> None:
        self._connection.send(msgspec.msgpack.encode({"type": type(message).__name__, **asdict(message)}))

    def _hear(self) -> None:
        try:
            for data in self._connection:
                assert isinstance(data, bytes)
                size = int.from_bytes(data[8:16], "little")
                inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])
                decoded = msgspec.msgpack.decode(inner)
                arrays, place = [], 16 + size
                for length in decoded["binaryBufferLengths"]:
                    place += -place % 8
                    arrays.append(data[place : place + length])
                    place += length
                with self._lock:
                    for message in decoded["messages"]:
                        self._take(_filled(message, arrays))
        except ConnectionClosed:
            pass

    def _take(self, message: dict[str, Any]) -> None:
        match message["type"]:
            case "RemoveSceneNodeMessage":
                gone = message["name"]
                for name in [each for each in self.scene if each == gone or each.startswith(f"{gone}/")]:
                    del self.scene[name]
            case "SetPositionMessage" | "SetOrientationMessage" if message["name"] in self.scene:
                self.scene[message["name"]].update({k: v for k, v in message.items() if k in ("position", "wxyz")})
            case "SceneNodeUpdateMessage" if message["name"] in self.scene:
                self.scene[message["name"]].update(message["updates"])
            case "GuiUpdateMessage" if message["uuid"] in self.fields:
                self.fields[message["uuid"]].update(message["updates"])
            case "GuiRemoveMessage":
                self.fields.pop(message["uuid"], None)
            case "NotificationMessage" | "NotificationShowMessage":
                props = message.get("props", message)
                self.notes.append(f"{props['title']}: {props['body']}")
            case kind if "props" in message and "uuid" in message and kind.startswith("Gui"):
                props = {"label": "", "visible": True} | message["props"]
                self.fields[message["uuid"]] = {"uuid": message["uuid"], "value": message.get("value")} | props
            case kind if "props" in message and "name" in message:
                self.scene[message["name"]] = {**message, **message["props"]}


def _filled(value: Any, arrays: list[bytes]) -> Any:
    """A message with its arrays."""
    match value:
        case {"__binary_index": index, "dtype": kind}:
            return np.frombuffer(arrays[index], kind)
        case dict():
            return {name: _filled(each, arrays) for name, each in value.items()}
    return value


@contextmanager
def visiting(url: str, size: tuple[int, int] = (800, 600)) -> Iterator[Visitor]:
    """A visitor of the page at this address, with the width and height of its window."""
    parts = urlsplit(url)
    with connect(
        f"ws://{parts.netloc}/",
        origin=f"http://{parts.netloc}",  # type: ignore[arg-type]
        subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
        additional_headers={"Cookie": f"rc-sim-{parts.port}={parts.query.removeprefix('token=')}"},
        max_size=None,
        open_timeout=SOON,
    ) as connection:
        visitor = Visitor(connection, size)
        try:
            yield visitor
        finally:
            visitor.close()
