"""The description of a scene in MuJoCo, `MjSpec`, which is edited in place: to copy it takes a fifth of an edit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Self

import mujoco
import numpy as np


class Draft:
    """A spec, and how to undo its last edit. It describes one scene at a time: an edit makes it that of the next scene.

    An edit may be rejected after the spec was changed; then the next edit undoes it first. A removal cannot be undone:
    a geom that is added again comes last in the order of geoms, and that order changes the last bits of contacts. So
    the spec is copied before a removal that may be rejected. A spec that several worlds share is copied, never changed.
    """

    def __init__(self, spec: mujoco.MjSpec) -> None:
        self.spec = spec
        self.is_shared = False
        """Whether several worlds have this spec."""
        self._mark: object = None
        """Identifies the scene that it describes; None before the first call of `taken` or `begin`."""
        self._undo: list[Callable[[], None]] | None = []
        """The steps of the last edit, to be undone in reverse order; None if the edit cannot be undone."""

    def taken(self, mark: object, *, keeps: bool) -> Self | None:
        """The draft to edit for the scene that follows the scene of `mark`; None if the spec of that scene is lost.

        With `keeps`, the draft is a copy, so that the spec of that scene remains if the edit is rejected.
        """
        if self.is_shared:
            return type(self)(self.spec.copy())
        if self._mark not in (None, mark):
            if self._undo is None:
                return None
            for step in reversed(self._undo):
                step()
            self._mark, self._undo = mark, []
        return type(self)(self.spec.copy()) if keeps else self

    def begin(self, mark: object) -> None:
        """From now on, it describes the scene of `mark`."""
        self._mark, self._undo = mark, []

    def will_add(self, name: str) -> None:
        """Note that a geom of this name is about to be added, so that this can be undone."""

        def undo() -> None:
            if (geom := self.spec.geom(name)) is not None:
                self.spec.delete(geom)

        if self._undo is not None:
            self._undo.append(undo)

    def set(self, geom: mujoco.MjsGeom, values: Mapping[str, Any]) -> None:
        """Change attributes of a geom. This can be undone."""
        before = {key: np.array(getattr(geom, key)) for key in values}

        def undo() -> None:
            _set(geom, before)

        if self._undo is not None:
            self._undo.append(undo)
        _set(geom, values)

    def remove(self, name: str) -> None:
        """Remove a geom. This cannot be undone."""
        self._undo = None
        self.spec.delete(self.spec.geom(name))


def _set(geom: mujoco.MjsGeom, values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        setattr(geom, key, value)
