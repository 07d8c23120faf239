"""What does not touch while physics is on: the parts of one robot, and what a robot stands on or is mounted on."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..innermodel.axes import Array

_APART = 0.001
"""What is nearer than this at the beginning touches, m."""


@dataclass(frozen=True, slots=True)
class Grounds:
    """What robots touch at the beginning."""

    pairs: frozenset[tuple[str, str]] = frozenset()
    """Bodies of robots, and shapes of the world."""
    level: float = -np.inf
    """How high what a base drives on may be, m; the highest of all bases."""
    middles: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Of the shapes of robots, shape (n, 3), m."""
    radii: Array = field(default_factory=lambda: np.zeros(0))
    """Of the spheres around them, shape (n,), m."""

    def may_have(self, model: mujoco.MjModel, shapes: Sequence[int]) -> bool:
        """Whether a robot might touch one of these shapes of the world. It is sure if not; else `grounds` knows."""
        for each in shapes:
            turn = np.empty(9)
            mujoco.mju_quat2Mat(turn, model.geom_quat[each])
            upwards, box = turn[6:], model.geom_aabb[each]
            top = model.geom_pos[each, 2] + upwards @ box[:3] + np.abs(upwards) @ box[3:]
            apart = np.linalg.norm(self.middles - model.geom_pos[each], axis=1)
            if top <= self.level + _APART or (apart < self.radii + model.geom_rbound[each] + 2 * _APART).any():
                return True
        return False


def part(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    start: Array,
    trees: Mapping[str, str],
    fixed: Mapping[str, tuple[mujoco.MjsGeom, dict[str, Any]]],
    driving: Set[str],
) -> tuple[bool, Grounds]:
    """Exclude contacts in a model that is about to be compiled again; whether there are any, and `grounds` of it.

    `start` are the positions at the beginning, `trees` the top of each body, `fixed` the shapes of the world, and
    `driving` the bodies of bases.
    """
    shaped = {model.body(body).name for body in model.geom_bodyid}
    pairs = [
        pair for pair in itertools.combinations(trees, 2) if trees[pair[0]] == trees[pair[1]] and shaped >= {*pair}
    ]
    touched = grounds(model, start, trees, driving)
    for shape in sorted({shape for _, shape in touched.pairs}):
        geom, made = fixed[shape]
        spec.delete(geom)
        spec.worldbody.add_body(name=shape).add_geom(**made)
    for one, other in (*pairs, *sorted(touched.pairs)):
        spec.add_exclude(bodyname1=one, bodyname2=other)
    return bool(pairs or touched.pairs), touched


def grounds(model: mujoco.MjModel, start: Array, trees: Mapping[str, str], driving: Set[str]) -> Grounds:
    """What robots touch at the beginning.

    What a base drives on may have several parts: all that is as low as what is under its origin.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_kinematics(model, data)
    still = np.flatnonzero(model.body_weldid[model.geom_bodyid] == 0)
    low, high = _extents(model, data, still)
    found, level, robots = set(), -np.inf, []
    for body in trees:
        number = model.body(body).id
        if model.body(trees[body]).jntnum[0] and model.jnt_type[model.body(trees[body]).jntadr[0]] == 0:
            continue  # a free body rests on what it touches
        own = np.flatnonzero(model.geom_bodyid == number)
        robots += own.tolist()
        touched = _touched(model, data, own, still)
        if body in driving:
            above = ((low <= data.xpos[number]) & (data.xpos[number] <= high))[:, :2].all(axis=1) & touched
            if above.any():
                level = max(level, highest := float(high[above, 2].max()) + _APART)
                touched |= high[:, 2] <= highest
        found |= {(body, model.geom(shape).name) for shape in still[touched].tolist()}
    return Grounds(frozenset(found), level, data.geom_xpos[robots], model.geom_rbound[robots])


def _touched(
    model: mujoco.MjModel, data: mujoco.MjData, own: NDArray[np.intp], others: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Which of the others touch one of the own, shape (len(others),)."""
    touched = np.zeros(len(others), dtype=bool)
    for one in own.tolist():
        reach = model.geom_rbound[one] + model.geom_rbound[others] + _APART
        apart = np.linalg.norm(data.geom_xpos[others] - data.geom_xpos[one], axis=1)
        for near in np.flatnonzero((apart < reach) & ~touched).tolist():
            touched[near] = mujoco.mj_geomDistance(model, data, one, others[near], 1.0, None) < _APART
    return touched


def _extents(model: mujoco.MjModel, data: mujoco.MjData, shapes: NDArray[np.intp]) -> tuple[Array, Array]:
    """The lowest and highest coordinates of shapes, each of shape (len(shapes), 3), m."""
    turns = data.geom_xmat[shapes].reshape(-1, 3, 3)
    middle = data.geom_xpos[shapes] + (turns @ model.geom_aabb[shapes, :3, None])[..., 0]
    half = (np.abs(turns) @ model.geom_aabb[shapes, 3:, None])[..., 0]
    return middle - half, middle + half
