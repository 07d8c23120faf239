"""How fast the joints of an arm have to move, so that its tool goes where it should."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from robocomp_py.innermodel import axes
from robocomp_py.innermodel.axes import Array
from robocomp_py.innermodel.read import InnerModelError
from robocomp_py.innermodel.tree import Tree

GAIN = 4.0
"""The speed of the tool for a unit of its error, 1/s."""
RELAXING = 1.0
"""How fast the joints go to their home positions, if the tool does not notice, 1/s."""
DAMPING = 1e-4
"""Keeps the joints slow near singularities, m²."""
FASTEST = 2.5
"""rad/s, of a joint."""


class Way(NamedTuple):
    """What is to be done until a goal is reached."""

    speeds: Array
    """Of the joints, rad/s, shape (n,)."""
    distance: float
    """mm"""
    turn: float
    """rad"""


class Arm:
    """The joints above a tool: resolved motion rate control (Whitney 1969), damped."""

    def __init__(self, tree: Tree, tool: str) -> None:
        self.tree, self.tool, self.root = tree, tool, tree.ids[0]
        above = [tool]
        while parent := tree.parent(above[-1]):
            above.append(parent)
        self.joints = [name for name in above[::-1] if tree.node(name).tag == "joint"]
        if not self.joints:
            raise InnerModelError(f"`{tool}` has no joint above it")
        homes = (tree.node(name).values["home"] for name in self.joints)
        self.home = np.array([float(str(each)) for each in homes])

    def way(
        self,
        positions: Mapping[str, float],
        goal: Array,
        velocity: Array,
        fastest: tuple[float, float],
    ) -> Way:
        """From the positions of the joints, rad, to a pose of the tool.

        The pose has shape (4, 4), and moves with a velocity in mm/s. `fastest` are the
        greatest speeds of the tool: mm/s and rad/s.
        """
        for name in self.joints:
            self.tree.update_joint(name, positions[name])
        now = self.tree.matrix(self.root, self.tool)
        distance = goal[:3, 3] - now[:3, 3]
        turn = turned(goal[:3, :3] @ now[:3, :3].T)
        moving = limited(GAIN * distance, fastest[0]) + velocity
        turning = limited(GAIN * turn, fastest[1])
        effect = self.tree.jacobian(self.joints, self.tool, self.root)
        effect[:3] /= 1000.0
        damped = effect @ effect.T + DAMPING * np.eye(6)
        inverse = effect.T @ np.linalg.inv(damped)
        speeds = inverse @ np.concatenate((moving / 1000.0, turning))
        present = np.array([positions[name] for name in self.joints])
        idle = RELAXING * (self.home - present)
        speeds += idle - inverse @ (effect @ idle)
        speeds *= min(1.0, FASTEST / max(np.abs(speeds).max(), 1e-9))
        lengths = float(np.linalg.norm(distance)), float(np.linalg.norm(turn))
        return Way(speeds, *lengths)

    def way_home(self, positions: Mapping[str, float]) -> Way:
        """The same to the home positions, by joints that move together."""
        left = self.home - np.array([positions[name] for name in self.joints])
        farthest = float(np.abs(left).max())
        return Way(
            GAIN * left * min(1.0, FASTEST / max(GAIN * farthest, 1e-9)), 0.0, farthest
        )


def limited(vector: Array, most: float) -> Array:
    """In the same direction, and at most so long."""
    return vector * min(1.0, most / max(float(np.linalg.norm(vector)), 1e-9))


def turned(matrix: Array) -> Array:
    """The axis of a rotation, as long as its angle in rad."""
    axis = np.array(
        (
            matrix[2, 1] - matrix[1, 2],
            matrix[0, 2] - matrix[2, 0],
            matrix[1, 0] - matrix[0, 1],
        )
    )
    sine = float(np.linalg.norm(axis)) / 2
    if sine < 1e-9:
        return np.zeros(3)
    return axis / (2 * sine) * math.atan2(sine, (np.trace(matrix) - 1) / 2)


def pose(
    place: tuple[float, float, float], angles: tuple[float, float, float]
) -> Array:
    """As a matrix, shape (4, 4): mm, rad."""
    return axes.pose(place, axes.rotation(*angles))
