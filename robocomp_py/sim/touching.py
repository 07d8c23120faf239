"""Which shapes of a simulated scene touch, and how far apart they are."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from ..innermodel import axes
from ..innermodel.axes import Array
from ..innermodel.read import InnerModelError
from .state import FARTHEST, State, existing


class Contact(NamedTuple):
    """Two shapes that touch."""

    one: str
    other: str
    force: float
    """With which they press on each other, N."""
    position: Array
    """Seen from the root, shape (3,), mm."""


class Touching(State):
    """A scene whose shapes can be compared."""

    def collide(self, one: str, other: str) -> bool:
        """Whether a shape at or below one node is inside of one at or below another; a mesh counts as its hull.

        What is below both counts for the second. Raises InnerModelError if there is no such node.
        """
        theirs = self._below(other)
        mine = self._below(one) - theirs
        model, data, shapes = self._scene.model, self._data, self._scene.shapes
        first = [number for number, name in enumerate(shapes) if name in mine]
        second = [number for number, name in enumerate(shapes) if name in theirs]
        for each in first:
            apart = np.linalg.norm(data.geom_xpos[second] - data.geom_xpos[each], axis=1)
            reach = model.geom_rbound[each] + model.geom_rbound[second]
            for near in np.array(second, dtype=int)[apart < reach].tolist():
                if mujoco.mj_geomDistance(model, data, each, near, 1.0, None) < 0.0:
                    return True
        return False

    def _below(self, name: str) -> set[str]:
        """A node and all below it."""
        existing("node", name, self._scene.frames)
        found, waiting = set(), [name]
        while waiting:
            found.add(name := waiting.pop())
            waiting += self._tree.node(name).children
        return found

    def contacts(self) -> list[Contact]:
        """What touches, and how hard, while physics is on: in the last tick, and of bodies that sleep, now."""
        found = [self._contact(self._data, number) for number in self._pressing(self._data)]
        if self._physics and (self._data.tree_asleep >= 0).any():
            awake = mujoco.MjData(self._scene.model)
            awake.qpos[:] = self._data.qpos
            mujoco.mj_forward(self._scene.model, awake)
            trees = self._scene.model.body_treeid[self._scene.model.geom_bodyid[awake.contact.geom]]
            sleeps = (self._data.tree_asleep[trees] >= 0) | (trees < 0)
            found += [self._contact(awake, number) for number in self._pressing(awake) if sleeps[number].all()]
        return sorted(found, key=lambda each: (each.one, each.other))

    def touching(self) -> list[tuple[str, str]]:
        """The pairs of shapes that touched in the last tick, each once; without those of bodies that sleep."""
        shapes, pressing = self._scene.shapes, self._pressing(self._data)
        if not pressing:
            return []
        pairs = {tuple(pair) for pair in self._data.contact.geom[pressing].tolist()}
        return sorted((min(shapes[a], shapes[b]), max(shapes[a], shapes[b])) for a, b in pairs)

    def distance(self, one: str, other: str) -> float:
        """The least distance of the shapes at or below two nodes, mm; less than 0: they overlap. A mesh is its hull.

        Raises InnerModelError for a node that is not there, or has no shapes.
        """
        model, data = self._scene.model, self._data
        mine, others = self._shapes_of(one), self._shapes_of(other)
        found = min(mujoco.mj_geomDistance(model, data, a, b, FARTHEST, None) for a in mine for b in others)
        return float(found) * 1000.0

    def _pressing(self, data: mujoco.MjData) -> list[int]:
        """The numbers of contacts that have a force."""
        if not self._physics or not data.ncon:
            return []
        return np.flatnonzero(data.contact.efc_address >= 0).tolist()

    def _contact(self, data: mujoco.MjData, number: int) -> Contact:
        contact, pressed = data.contact[number], np.empty(6)
        mujoco.mj_contactForce(self._scene.model, data, number, pressed)
        one, other = sorted(self._scene.shapes[each] for each in contact.geom)
        return Contact(one, other, float(np.linalg.norm(pressed[:3])), axes.position_from_simulation(contact.pos))

    def _shapes_of(self, name: str) -> list[int]:
        """The geoms at or below a node."""
        below = self._below(name)
        found = [number for number, shape in enumerate(self._scene.shapes) if shape in below]
        if not found:
            raise InnerModelError(f"`{name}` has no shapes, so it has no distance from anything")
        return found
