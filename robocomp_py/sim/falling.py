"""Free bodies that fall out of the scene. They are put to rest: after hours, their numbers would end the simulation."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

DEEPEST = 1000.0
"""A body that has fallen this far below the root is put to rest, m."""

EVERY = 200
"""Ticks between two looks at whether one has."""


def caught(model: mujoco.MjModel, data: mujoco.MjData, free: NDArray[np.intp]) -> list[int]:
    """Put to rest what has fallen too deep since the last look, and return its bodies. `free` are all free joints."""
    found = []
    for joint in free[data.qpos[model.jnt_qposadr[free] + 2] < -DEEPEST].tolist():
        moved = carried(model, joint)
        if not data.xfrc_applied[moved].any():
            data.qvel[np.isin(model.dof_bodyid, moved)] = 0.0
            weights = (model.body_mass * (1.0 - model.body_gravcomp))[moved]
            data.xfrc_applied[moved, :3] = -weights[:, None] * model.opt.gravity
            found.append(int(model.jnt_bodyid[joint]))
    return found


def let_go(model: mujoco.MjModel, data: mujoco.MjData, joint: int) -> None:
    """Let what a free joint moves have weight again."""
    data.xfrc_applied[carried(model, joint)] = 0.0


def carried(model: mujoco.MjModel, joint: int) -> NDArray[np.intp]:
    """The bodies that a free joint moves."""
    return np.flatnonzero(model.body_treeid == model.body_treeid[model.jnt_bodyid[joint]])
