"""A sensor of contact: a bumper, or a sensor of force."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from ...innermodel import axes
from ...innermodel.read import number_of
from ...innermodel.tree import Tree
from ..build import Frame, Scene


class Touch:
    """Feels what touches the shapes below its node; if there are none, those of the body that it is part of."""

    def __init__(self, tree: Tree, name: str, scene: Scene) -> None:
        node, model = tree.node(name), scene.model
        self._frame: Frame = scene.frames[name]
        normal = np.array([number_of(node.values[f"n{axis}"]) for axis in "xyz"])
        length = float(np.linalg.norm(normal))
        self._normal = axes.TO_SIMULATION @ normal / length if length else None
        self._is_bumper = str(node.values["type"]).lower() == "bumper"
        self._low, self._high = number_of(node.values["min"]), number_of(node.values["max"])
        below = {name}
        for each in tree.ids:  # parents first
            if tree.node(each).parent in below:
                below.add(each)
        self._own = np.array([shape in below for shape in scene.shapes], dtype=bool)
        if not self._own.any():
            self._own = model.geom_bodyid == self._frame.body
        self._others = _foreign(model, self._frame.body)
        mover = model.body_treeid[self._frame.body]
        self.needs_waking = mover < 0 or model.tree_sleep_policy[mover] == mujoco.mjtSleepPolicy.mjSLEEP_AUTO_ALLOWED
        """Whether bodies that rest on it might sleep: their contacts are not computed then."""

    def read(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """The force that presses on it, N, or of a bumper 1 or 0; from the last step of physics."""
        total, touched = np.zeros(3), False
        found = np.empty(6)
        contacts = data.contact
        pairs = contacts.geom
        mine = self._own[pairs]
        for number in np.flatnonzero(mine[:, 0] != mine[:, 1]).tolist() if len(pairs) else ():
            if contacts.efc_address[number] < 0:
                continue
            touched = True
            mujoco.mj_contactForce(model, data, number, found)
            force = found[:3] @ contacts.frame[number].reshape(3, 3)  # on the second of the two
            total += force if mine[number, 1] else -force
        if self._is_bumper:
            return float(touched)
        if self._normal is None:
            return self._limited(float(np.linalg.norm(total)))
        turn = data.xmat[self._frame.body].reshape(3, 3) @ self._frame.rotation
        return self._limited(-float(total @ turn @ self._normal))

    def overlaps(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """1 if a shape of it overlaps one of something else, else 0: what it tells while physics is off."""
        others = np.flatnonzero(self._others)
        for one in np.flatnonzero(self._own).tolist():
            reach = model.geom_rbound[one] + model.geom_rbound[others]
            apart = np.linalg.norm(data.geom_xpos[others] - data.geom_xpos[one], axis=1)
            for other in others[apart < reach].tolist():
                if mujoco.mj_geomDistance(model, data, one, other, 1.0, None) < 0.0:
                    return 1.0
        return 0.0

    def _limited(self, force: float) -> float:
        return min(max(force, self._low), self._high) + 0.0 if math.isfinite(force) else force


def _foreign(model: mujoco.MjModel, body: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which geoms a body may touch: not those of its own robot, nor what that stands on."""
    if body == 0:
        apart = model.body_weldid != 0
    else:
        apart = model.body_rootid != model.body_rootid[body]
        for signature in model.exclude_signature.tolist():
            one, other = divmod(signature, 1 << 16)
            if body in (one, other):
                apart[one if other == body else other] = False
    found: np.ndarray[tuple[int], np.dtype[np.bool_]] = apart[model.geom_bodyid]
    return found
