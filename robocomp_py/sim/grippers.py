"""Suction cups and magnets: what they reach when they are switched on, they hold where it is.

A gripper has a weld with each body that moves freely, of which at most one is active. Where a body is held is part of
the model, so worlds with grippers have models of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from .names import of_part

_RELATIVE, _TURN = slice(3, 6), slice(6, 10)
"""Of the data of a weld: where the second body is seen from the first."""


@dataclass(frozen=True, slots=True)
class Gripper:
    reach: float
    """m."""
    shapes: Sequence[int]
    """Its geoms."""
    welds: Mapping[str, int]
    """By the id of a body that moves freely: the number of the weld that holds it."""
    bodies: Mapping[str, Sequence[int]]
    """By the id of a body that moves freely: its geoms."""


def add(spec: mujoco.MjSpec, name: str, body: str, free: Mapping[str, str]) -> None:
    """Add the welds of a gripper that is part of a body. `free` are the bodies that move freely, by their ids."""
    for each, other in free.items():
        spec.add_equality(
            name=_weld(name, each),
            type=mujoco.mjtEq.mjEQ_WELD,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1=body,
            name2=other,
            active=False,
        )


def made(
    model: mujoco.MjModel, name: str, reach: float, shapes: Sequence[int], free: Mapping[str, Sequence[int]]
) -> Gripper:
    """The gripper in a compiled model; `free` are the geoms of the bodies that move freely, by their ids."""
    welds = {each: model.equality(_weld(name, each)).id for each in free}
    return Gripper(reach, shapes, welds, free)


def nearest(gripper: Gripper, model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """The id of the nearest body within reach; "" if no body is within reach."""
    found, least = "", gripper.reach
    for name, shapes in gripper.bodies.items():
        for one in gripper.shapes:
            for other in shapes:
                apart = np.linalg.norm(data.geom_xpos[one] - data.geom_xpos[other])
                if apart - model.geom_rbound[one] - model.geom_rbound[other] > least:
                    continue
                distance = mujoco.mj_geomDistance(model, data, one, other, 1.0 + least, None)
                if distance < least or (distance == least and not found):
                    found, least = name, distance
    return found


def hold(model: mujoco.MjModel, data: mujoco.MjData, weld: int) -> None:
    """Hold a body where it is. The poses of all bodies in `data` have to be those of now."""
    one, other = model.eq_obj1id[weld], model.eq_obj2id[weld]
    inverse, turn = np.empty(4), np.empty(4)
    mujoco.mju_negQuat(inverse, data.xquat[one])
    mujoco.mju_mulQuat(turn, inverse, data.xquat[other])
    model.eq_data[weld, :3] = 0.0
    model.eq_data[weld, _RELATIVE] = data.xmat[one].reshape(3, 3).T @ (data.xpos[other] - data.xpos[one])
    model.eq_data[weld, _TURN] = turn
    data.eq_active[weld] = 1


def _weld(name: str, body: str) -> str:
    return of_part(name, body)
