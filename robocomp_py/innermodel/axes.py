"""Rotations, and the axes of InnerModel.

InnerModel is left-handed: x to the right, y up, z ahead; lengths in mm, angles in rad. Matrices have the usual form:
`R = Rx(a) · Ry(b) · Rz(c)` and `T(t) · R`, from a child to its parent. With these axes, a positive turn about y is to
the right.

MuJoCo and most other libraries are right-handed: X ahead, Y left, Z up; lengths in m. The matrix `TO_SIMULATION` leads
there. Its determinant is negative, and must be: a proper rotation would pass every test of kinematics and mirror the
world. Only pictures show that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TO_SIMULATION: Array = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Turns the axes of InnerModel into those of the simulator; see `position_to_simulation` and its neighbours."""
TO_SIMULATION.flags.writeable = False

_SINGULAR = 1e-9
"""How near to a quarter turn about y the other two angles are no longer told apart."""


def rotation(x: float, y: float, z: float) -> Array:
    """`Rx(x) · Ry(y) · Rz(z)`, shape (3, 3); angles in rad."""
    sx, cx, sy, cy, sz, cz = math.sin(x), math.cos(x), math.sin(y), math.cos(y), math.sin(z), math.cos(z)
    return np.array(
        (
            (cy * cz, -cy * sz, sy),
            (cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy),
            (sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy),
        )
    )


def angles(matrix: Array) -> Array:
    """The angles x, y, z of a rotation, shape (3,), in rad.

    Of the two solutions, the one whose angles are smaller is taken. They are not normalised, so one may exceed π. At a
    quarter turn about y, x is 0. No angle is -0.
    """
    (xx, xy, xz), (yx, yy, yz), (_, _, zz) = matrix.tolist()
    sine = min(1.0, max(-1.0, xz))
    if 1.0 - abs(sine) < _SINGULAR:
        return np.array((0.0, math.copysign(math.pi / 2, sine), math.atan2(yx, yy))) + 0.0
    found = []
    for y in (math.asin(sine), math.pi - math.asin(sine)):
        sign = math.copysign(1.0, math.cos(y))
        x = math.atan2(-sign * yz, sign * zz)
        z = math.atan2(-sign * xy, sign * xx)
        found.append((x, y, z))
    return np.array(min(found, key=lambda each: math.hypot(*each))) + 0.0


def pose(translation: Sequence[float], turn: Array) -> Array:
    """The matrix `T(translation) · turn`, shape (4, 4)."""
    made = np.zeros((4, 4))
    made[:3, :3] = turn
    made[:3, 3] = translation
    made[3, 3] = 1.0
    return made


def inverse(matrix: Array) -> Array:
    """The inverse of a pose, shape (4, 4)."""
    made = np.eye(4)
    made[:3, :3] = matrix[:3, :3].T
    made[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return made


def cross(one: Array, other: Array) -> Array:
    """The cross product of two vectors, shape (3,). For a single pair, that of numpy takes ten times as long."""
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()
    return np.array((b * z - c * y, c * x - a * z, a * y - b * x))


def about(axis: str, angle: float) -> Array:
    """The rotation by an angle in rad about `x`, `y` or `z`, shape (3, 3)."""
    return rotation(*(angle if each == axis else 0.0 for each in "xyz"))


def along_normal(normal: Sequence[float]) -> Array:
    """The rotation of a plane with this normal, shape (3, 3).

    It turns -z to the normal by the smallest angle; +z by half a turn about y. A plane without a normal is not turned.
    """
    length = math.hypot(*normal)
    if length == 0.0:
        return np.eye(3)
    unit = np.array(normal, dtype=float) / length
    beside = unit[0] * unit[0] + unit[1] * unit[1]
    short = beside / (1.0 + unit[2]) if unit[2] > 0.0 else 1.0 - unit[2]  # 1 - z, which loses digits near z = 1
    if short < 1e-12:
        return rotation(0.0, math.pi, 0.0)
    axis = np.cross((0.0, 0.0, -1.0), unit)
    cross = np.array(((0.0, -axis[2], axis[1]), (axis[2], 0.0, -axis[0]), (-axis[1], axis[0], 0.0)))
    made: Array = np.eye(3) + cross + cross @ cross / short
    return made


def position_to_simulation(position: Array) -> Array:
    """Points in mm, shape (…, 3), to the simulator's axes, in m."""
    return position @ TO_SIMULATION.T * 0.001


def position_from_simulation(position: Array) -> Array:
    """Points of the simulator in m, shape (…, 3), to mm in our axes. No number is -0."""
    return position @ TO_SIMULATION * 1000.0 + 0.0


def rotation_to_simulation(turn: Array) -> Array:
    """A rotation, shape (…, 3, 3), in the simulator's axes. Also the way back of `rotation_from_simulation`."""
    made: Array = TO_SIMULATION @ turn @ TO_SIMULATION.T
    return made


def rotation_from_simulation(turn: Array) -> Array:
    made: Array = TO_SIMULATION.T @ turn @ TO_SIMULATION
    return made


def turn_to_simulation(vector: Array) -> Array:
    """The axis of a hinge, or an angular velocity, shape (…, 3), in the simulator's axes.

    It changes its sign, because a turn in left-handed axes runs the other way round.
    """
    return -(vector @ TO_SIMULATION.T)


def turn_from_simulation(vector: Array) -> Array:
    """The way back. No number is -0."""
    return 0.0 - vector @ TO_SIMULATION
