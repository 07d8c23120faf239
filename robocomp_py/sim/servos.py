"""The servos of robots: what their motors do while physics is on.

A base has three servos of speeds, ahead, aside and in turn, on a site in its frame: commands need no frame of the
world. A base that its own `rx` tilts drives in the plane of its parent, which no site in its frame has: its first two
servos act along z and x of the parent. A joint has a servo that holds it at a position, and lets it move without delay.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from ..innermodel.axes import Array
from .names import of_part, split

_STIFFNESS = 0.5
"""Of the servos of joints: their own frequency in rad/s, times the length of a step."""
_TRACTION = 9.81
"""The most force of a base for each kg of the robot, N: that of wheels whose friction is 1."""
_PARTS = {"ahead": (1, 0, 0, 0, 0, 0), "aside": (0, -1, 0, 0, 0, 0), "turn": (0, 0, 0, 0, 0, -1)}
"""Of a base: the directions of its servos in the axes of MuJoCo."""
_SLIDES = {"ahead": "z", "aside": "x"}
"""Of a base that is tilted: the joints on which its servos act."""


def of_base(base: str) -> str:
    """The name of the first servo of a base."""
    return of_part(base, "ahead")


def add_to_base(spec: mujoco.MjSpec, base: str, *, is_tilted: bool) -> None:
    spec.body(base).add_site(name=base)
    for part, direction in _PARTS.items():
        servo = spec.add_actuator(
            name=of_part(base, part), trntype=mujoco.mjtTrn.mjTRN_SITE, target=base, gear=direction
        )
        if is_tilted and part in _SLIDES:
            servo.trntype, servo.target = mujoco.mjtTrn.mjTRN_JOINT, of_part(base, _SLIDES[part])
            servo.gear = (1, 0, 0, 0, 0, 0)
        servo.set_to_velocity(kv=1.0)
        servo.forcelimited = True
        servo.forcerange = -1.0, 1.0


def add_to_joint(spec: mujoco.MjSpec, joint: str) -> None:
    servo = spec.add_actuator(name=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)
    servo.set_to_position(kp=1.0, kv=1.0)


def lag(tick: float) -> float:
    """How far behind a moving reference the servo of a joint stays, s: controls are ahead by this."""
    return 2.0 * tick / _STIFFNESS


def tune(model: mujoco.MjModel, start: Array, forces: Mapping[str, float]) -> None:
    """Set the gains of all servos by the inertia that they move, and their forces.

    The inertia about a hinge differs with the pose of what it carries, and a servo is slow if it moves more than it was
    made for. So the greatest one counts. A servo at its greatest force is not integrated implicitly: the gain of a base
    is a quarter of what would explode then, and that of a joint with a greatest force is made for the first pose.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_forward(model, data)
    inertias = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertias)
    tick = model.opt.timestep
    for number in range(model.nu):
        name, target = model.actuator(number).name, model.actuator_trnid[number, 0]
        if model.actuator_trntype[number] == mujoco.mjtTrn.mjTRN_JOINT and model.joint(target).name == name:
            inertia, stiffness = inertias[(model.jnt_dofadr[target],) * 2], _STIFFNESS / tick
            if name not in forces and model.jnt_type[target] == mujoco.mjtJoint.mjJNT_HINGE:
                inertia = max(inertia, _most_inertia(model, model.jnt_bodyid[target]))
            gain, damping = inertia * stiffness**2, 2.0 * inertia * stiffness
            model.actuator_gainprm[number, 0] = gain
            model.actuator_biasprm[number, 1:3] = -gain, -damping
            if name in forces:
                model.actuator_forcelimited[number] = True
                model.actuator_forcerange[number] = -forces[name], forces[name]
            continue
        base, part = split(name)
        freedom = model.jnt_dofadr[model.joint(of_part(base, "turn" if part == "turn" else "x")).id]
        gain = inertias[freedom, freedom] / (2.0 * tick)
        model.actuator_gainprm[number, 0], model.actuator_biasprm[number, 2] = gain, -gain
        mass = inertias[(model.jnt_dofadr[model.joint(of_part(base, "x")).id],) * 2]
        most = forces.get(base, _TRACTION * mass) * (_arm(model, base) if part == "turn" else 1.0)
        model.actuator_forcerange[number] = -most, most


def _most_inertia(model: mujoco.MjModel, carried: int) -> float:
    """The most that the inertia about a hinge can be when all that it carries is stretched out, kg m²."""
    reach, found = {carried: 0.0}, 0.0
    for body in range(carried, model.nbody):  # parents have lower numbers
        if body != carried:
            if (above := int(model.body_parentid[body])) not in reach:
                continue
            reach[body] = reach[above] + float(np.linalg.norm(model.body_pos[body]))
        away = reach[body] + float(np.linalg.norm(model.body_ipos[body]))
        found += float(model.body_mass[body]) * away**2 + float(model.body_inertia[body].max())
    return found


def _arm(model: mujoco.MjModel, base: str) -> float:
    """How far its wheels are from the middle of a base, m: the radius of inertia of its body."""
    body = model.body(base).id
    return float(np.sqrt(model.body_inertia[body].max() / model.body_mass[body]))
