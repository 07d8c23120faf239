"""What a world keeps when its tree is edited while it goes on."""

from __future__ import annotations

import hashlib

import mujoco
import numpy as np

from ..innermodel.tree import Tree
from .build import Scene

_PLACES = {mujoco.mjtJoint.mjJNT_FREE: 7, mujoco.mjtJoint.mjJNT_BALL: 4}
_FREEDOMS = {mujoco.mjtJoint.mjJNT_FREE: 6, mujoco.mjtJoint.mjJNT_BALL: 3}
"""Numbers in the vectors of positions and of velocities; 1 of other joints."""


def carry(old: Scene, before: mujoco.MjData, new: Scene, after: mujoco.MjData) -> None:
    """Give what two scenes have in common the state that it had: positions, velocities, and what servos are told."""
    if new.joints is old.joints:  # only what stands still has changed
        for name in ("qpos", "qvel", "qacc_warmstart", "xfrc_applied", "ctrl", "eq_active"):
            getattr(after, name)[:] = getattr(before, name)
        new.model.eq_data[:] = old.model.eq_data
        return
    for number in range(new.model.njnt):
        joint = new.model.joint(number)
        found = mujoco.mj_name2id(old.model, mujoco.mjtObj.mjOBJ_JOINT, joint.name)
        if found < 0 or old.model.jnt_type[found] != new.model.jnt_type[number]:
            continue
        kind = mujoco.mjtJoint(int(new.model.jnt_type[number]))
        places, freedoms = _PLACES.get(kind, 1), _FREEDOMS.get(kind, 1)
        place, was = new.model.jnt_qposadr[number], old.model.jnt_qposadr[found]
        after.qpos[place : place + places] = before.qpos[was : was + places]
        freedom, was = new.model.jnt_dofadr[number], old.model.jnt_dofadr[found]
        for name in ("qvel", "qacc_warmstart"):
            getattr(after, name)[freedom : freedom + freedoms] = getattr(before, name)[was : was + freedoms]
    for number in np.flatnonzero(before.xfrc_applied.any(axis=1)).tolist():
        found = mujoco.mj_name2id(new.model, mujoco.mjtObj.mjOBJ_BODY, old.model.body(number).name)
        if found >= 0:
            after.xfrc_applied[found] = before.xfrc_applied[number]
    for number in range(new.model.nu):
        found = mujoco.mj_name2id(old.model, mujoco.mjtObj.mjOBJ_ACTUATOR, new.model.actuator(number).name)
        if found >= 0:
            after.ctrl[number] = before.ctrl[found]
    for number in range(new.model.neq):
        name = new.model.equality(number).name
        found = mujoco.mj_name2id(old.model, mujoco.mjtObj.mjOBJ_EQUALITY, name)
        if found >= 0:
            after.eq_active[number] = before.eq_active[found]
            new.model.eq_data[number] = old.model.eq_data[found]


def fingerprint(tree: Tree) -> bytes:
    """The same for trees with the same nodes."""
    made = hashlib.sha256()
    for name in tree.ids:
        node = tree.node(name)
        made.update(repr((node.tag, node.parent, sorted(node.values.items()))).encode())
    return made.digest()
