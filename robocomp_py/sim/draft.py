"""The spec of a scene, which is edited for the scene after it: a copy would take a fifth of the time of an edit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Self

import mujoco
import numpy as np


class Draft:
    """A spec, which belongs to one scene at a time, and how to undo its last edit.

    An edit may be rejected after the spec was changed; then the next edit undoes it first. A removal cannot be undone:
    a geom that is added again comes last in the order of geoms, which decides about the last bits of contacts. So the
    spec is copied before a removal that may be rejected. The spec of several worlds is copied, too, and never changed.
    """

    def __init__(self, spec: mujoco.MjSpec) -> None:
        self.spec = spec
        self.is_shared = False
        """Whether several worlds have it."""
        self._mark: object = None
        """That of the scene to which it belongs; None: of the first one that asks for it."""
        self._undo: list[Callable[[], None]] | None = []
        """What leads back to the scene before, last step first; None: nothing does."""

    def taken(self, mark: object, *, keeps: bool) -> Self | None:
        """A draft with the spec of a scene, to be changed for the scene after it; None if that spec is lost.

        With `keeps`, it can be used for this scene again if the change is rejected.
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
        """From now on, it belongs to another scene."""
        self._mark, self._undo = mark, []

    def will_add(self, name: str) -> None:
        """Prepare for a geom that is about to be added."""

        def undo() -> None:
            if (geom := self.spec.geom(name)) is not None:
                self.spec.delete(geom)

        if self._undo is not None:
            self._undo.append(undo)

    def set(self, geom: mujoco.MjsGeom, values: Mapping[str, Any]) -> None:
        """Change a geom."""
        before = {key: np.array(getattr(geom, key)) for key in values}

        def undo() -> None:
            _set(geom, before)

        if self._undo is not None:
            self._undo.append(undo)
        _set(geom, values)

    def remove(self, name: str) -> None:
        """Remove a geom."""
        self._undo = None
        self.spec.delete(self.spec.geom(name))


def _set(geom: mujoco.MjsGeom, values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        setattr(geom, key, value)
