"""A running scene on a page: it is asked what it has, and heard where everything moves to."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from ...client.connection import Connection
from ...client.session import NotThere, Session
from ...errors import RobocompError, Timeout
from ...innermodel import axes
from ...innermodel.axes import Array
from ...innermodel.tree import Tree
from ...spelling import unknown
from ...tools.network import Network
from .page import Page
from .shapes import Cloud
from .viewing import Show, Tell

_LOOK = 1.0
"""Seconds between two looks at whether the scene was edited."""

_PATIENCE = 0.25
"""Seconds for which a message is awaited before anything else is done."""

_OPERATION = "/Simulation/now"
"""The end of the channel by which a component that simulates is found."""


def simulators(network: Network) -> list[str]:
    """The components of a network that simulate a scene."""
    return [name.removesuffix(_OPERATION) for name in network.channels if name.endswith(_OPERATION)]


def chosen(network: Network, wanted: str = "") -> str:
    """The component whose scene is shown. Raises NotThere."""
    found = simulators(network)
    if wanted and wanted not in found:
        raise NotThere(unknown("component with a scene", wanted, found))
    if len(found) == 1 or wanted:
        return wanted or found[0]
    if found:
        raise NotThere(f"several components simulate a scene; choose one by --component: {', '.join(found)}")
    raise NotThere("no component that is ready simulates a scene; `rc sim new` writes one")


class LiveShow(Show):
    """The scene of a running component on a page. Only while a page is open, the component is asked anything."""

    def __init__(self, page: Page, session: Session, name: str, tell: Tell) -> None:
        """Raises a RobocompError if the scene cannot be asked for."""
        super().__init__(page, tell)
        self._connection, self._name = Connection(session), name
        self._text = ""
        self._clouds: dict[str, Cloud] = {}
        self._versions: dict[str, int] = {}
        """Of clouds."""
        self._trouble = ""
        self._time: Any = page.server.gui.add_text("time", "", disabled=True)
        self._renew()

    def follow(self, is_ended: threading.Event) -> None:
        """Show what happens until the event is set."""
        heard, looked = None, 0.0
        while not is_ended.is_set():
            if not self.is_seen:
                is_ended.wait(_PATIENCE)
                looked = 0.0  # then all is asked for again
                continue
            try:
                if time.monotonic() - looked > _LOOK:
                    looked = time.monotonic()
                    self._renew()
                if heard is None:
                    heard = self._connection[f"{self._name}/SimulationPub/advanced"].listen(_PATIENCE)
                self._advance(next(heard))
            except Timeout:
                continue
            except RobocompError as exc:
                self._complain(str(exc))
                is_ended.wait(_PATIENCE)

    def where(self, node: str) -> Array:
        """The true pose of a node, seen from the root."""
        pose = self._connection[f"{self._name}/InnerModelManager"].getPose("root", node).pose
        return _matrix(pose)

    def place(self, node: str) -> str:
        """Empty: the component tells the scene as it is now, with all edits, which no file has."""
        return ""

    def _renew(self) -> None:
        """Show the scene as it is, with all edits."""
        simulation = self._connection[f"{self._name}/Simulation"]
        if "scene" not in simulation:
            raise NotThere(f"{self._name} does not tell its scene: generate its code again, with rcgen, and restart it")
        text = simulation.scene()
        poses = {each.id: _matrix(each) for each in simulation.poses([])}
        is_new = text != self._text
        if is_new:
            self._text, self.tree = text, Tree.read(Path(self._name), reading=lambda path: text.encode())
        if self._heard_clouds(simulation) or is_new:
            self.show(self.tree, poses, self._clouds)
        self.scene.place(poses)  # a message that told of one may have been lost
        self.tell_again()
        self._trouble = ""

    def _heard_clouds(self, simulation: Any) -> bool:
        """Ask for the points of clouds; whether there are others than before."""
        before = dict(self._clouds)
        names = [name for name, tag in self.tree.tags.items() if tag == "pointcloud" and "cloud" in simulation]
        for name in names:
            told = simulation.cloud(name, self._versions.get(name, 0))
            if told.version != self._versions.get(name, 0):
                points = axes.position_to_simulation(np.array(told.points, float).reshape(-1, 3))
                colours = np.array(told.colours, np.uint8).reshape(-1, 3)
                is_there = np.isfinite(points).all(axis=1)  # cameras tell NaN where nothing is
                cloud = Cloud(points[is_there].astype(np.float32), colours[is_there])
                self._clouds[name], self._versions[name] = cloud, told.version
            if name in self._clouds and not len(self._clouds[name].points):
                del self._clouds[name]  # browsers refuse to draw nothing
        for name in self._clouds.keys() - set(names):
            del self._clouds[name], self._versions[name]
        return self._clouds != before

    def _advance(self, message: Any) -> None:
        self.scene.place({each.id: _matrix(each) for each in message.moved})
        at = message.at
        state = "stands still" if at.paused else f"{at.reached:.2g} × real time"
        self._time.value = f"{at.time:.1f} s, {state}{', physics' if at.physics else ''}"

    def _complain(self, text: str) -> None:
        self._versions.clear()  # a component that was started again counts from the beginning
        if text != self._trouble:
            self._trouble = text
            self._time.value = "not heard"
            self._tell(text)


def _matrix(pose: Any) -> Array:
    return axes.pose((pose.x, pose.y, pose.z), axes.rotation(pose.rx, pose.ry, pose.rz))
