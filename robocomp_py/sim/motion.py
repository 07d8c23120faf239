"""How a simulated scene goes on: by physics, or as bases and joints are told."""

from __future__ import annotations

import logging
import math
import operator

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..errors import RobocompError
from ..innermodel.axes import Array
from .bases import Drive, Speed, Three, between, in_parent, moved
from .build import Base
from .falling import DEEPEST, EVERY, caught
from .joints import moved as motor_moved
from .noise import normal
from .servos import lag
from .speeds import speed_of
from .state import FARTHEST, State

_LEAST_FACTOR = 0.01
"""The least part of a base's speed that noise leaves."""

TOUCH = 1e-9
"""How much deeper than before a shape of a base may be in another one, m."""

_EXACT = 1.0, 1.0, 1.0
"""What no noise makes of the parts of a base's speed."""

_BAD_POSITION = int(mujoco.mjtWarning.mjWARN_BADQPOS)
_BAD_VELOCITY = int(mujoco.mjtWarning.mjWARN_BADQVEL)
_BAD_ACCELERATION = int(mujoco.mjtWarning.mjWARN_BADQACC)

log = logging.getLogger("robocomp.sim")

_logging = mujoco.MjLogConfig.get()
_logging.logto_file = False  # of warnings, into the folder of whatever imports this: exceptions tell them
_logging.set()


class SimulationError(RobocompError):
    """Physics has no result for a scene: its state is no longer one that could be."""


class Motion(State):
    """A scene that goes on in ticks."""

    def step(self, count: int = 1) -> None:
        """Go on by some ticks."""
        if count < 0:
            raise ValueError(f"{count} ticks")
        for left in reversed(range(count)):
            self._ticks += 1
            if self._physics:
                self._act()
            else:
                self._glide(with_speeds=not left or bool(self._imus))
            if self._imus:
                self._feel()
        if not self._imus or not count:
            self._update()

    def _feel(self) -> None:
        """Note the acceleration of inertial units: the change of their speed in the tick."""
        self._update()
        self._update_speeds()
        for name, frame in self._imus.items():
            velocity, _ = speed_of(self._scene.model, self._data, frame)
            change = (velocity - self._inertias[name].velocity) / self._tick
            self._inertias[name] = self._inertias[name]._replace(
                velocity=tuple(velocity.tolist()), acceleration=tuple(change.tolist())
            )

    def _turn_joints(self) -> None:
        """Turn those that have a goal. Those without one need not be looked at again."""
        motors, joints, tick, ahead = self._motors, self._scene.joints, self._tick, lag(self._tick)
        for name in tuple(self._busy):
            motor, joint = motors[name], joints[name]
            if motor.goal is not None:
                low, high = max(joint.low, -FARTHEST), min(joint.high, FARTHEST)
                motors[name] = motor = motor_moved(motor, tick, low, high)
                if not self._physics:
                    self._places[joint.place] = joint.place_of(motor.position)
            if self._physics:
                self._data.ctrl[joint.servo] = joint.place_of(motor.position + motor.speed * ahead)
            if motor.goal is None:
                del self._busy[name]

    def _glide(self, *, with_speeds: bool) -> None:
        """Move joints and bases for a tick, as they are told; `with_speeds`, compute the vector of speeds."""
        before = self._data.qpos.copy() if with_speeds else None
        self._turn_joints()
        for base, drive in self._driven:
            self._advance(base, drive)
        if before is not None:
            mujoco.mj_differentiatePos(self._scene.model, self._data.qvel, self._tick, before, self._data.qpos)

    def _act(self) -> None:
        """Let physics move everything for a tick."""
        if self._busy:
            self._turn_joints()
        places, told, noise, began = self._places, self._told, self._noise, []
        for base, drive in self._driven:
            x, z, turn = places[base.x], places[base.z], places[base.turn]
            factors = _EXACT
            if drive.expires is not None or any(drive.speed):
                self._expire(drive, (x * 1000.0, z * 1000.0, turn))
            if told.get(base.name) is not drive.speed or base.is_tilted or (noise and base.name in noise):
                factors = self._factors(base.name)
                self._tell(base, drive.speed, factors)
            began.append((base, drive, x, z, turn, factors))
        mujoco.mj_step(self._scene.model, self._data)
        warnings = self._warnings
        if warnings[_BAD_POSITION] or warnings[_BAD_VELOCITY] or warnings[_BAD_ACCELERATION]:
            raise SimulationError(
                f"physics became unstable after {self.time:.3f} s, at `{self._unstable()}`: "
                "shapes may overlap, or masses may differ too much"
            )
        if self._ticks % EVERY == 0:
            self._catch()
        for base, drive, x, z, turn, factors in began:
            to_x, to_z, to = places[base.x], places[base.z], places[base.turn]
            if to_x != x or to_z != z or to != turn:
                self._roll(drive, (x * 1000.0, z * 1000.0, turn), (to_x * 1000.0, to_z * 1000.0, to), factors)

    def _unstable(self) -> str:
        """The node of the first body that has no place, speed or acceleration any more."""
        model, warnings = self._scene.model, self._data.warning
        if warnings.number[_BAD_POSITION]:
            joint = np.searchsorted(model.jnt_qposadr, warnings.lastinfo[_BAD_POSITION], side="right") - 1
        else:
            kind = _BAD_VELOCITY if warnings.number[_BAD_VELOCITY] else _BAD_ACCELERATION
            joint = model.dof_jntid[warnings.lastinfo[kind]]
        return self._scene.node_of(int(model.jnt_bodyid[joint]))

    def _catch(self) -> None:
        """Put to rest what has fallen out of the scene."""
        for body in caught(self._scene.model, self._data, self._free):
            text = "`%s` has fallen more than %g m below the scene by %.1f s, and stays there"
            log.warning(text, self._scene.node_of(body), DEEPEST, self.time)

    def _tell(self, base: Base, speed: Speed, factors: Three) -> None:
        """Tell the servos of a base."""
        ahead, aside, turn = map(operator.mul, speed, factors)
        if base.is_tilted:
            ahead, aside = in_parent(self._pose(base.name), (ahead, aside, turn), self._tick)
        self._data.ctrl[base.servo : base.servo + 3] = ahead / 1000.0, aside / 1000.0, turn
        self._told[base.name] = speed

    def _roll(self, drive: Drive, before: Three, after: Three, factors: Three) -> None:
        """Let the wheels of a base measure how it has moved in a tick; noise does `factors` to its speed."""
        if after == before:
            return
        tick, odometry, corrected = self._tick, drive.odometry, drive.corrected
        speed = between(before, after, tick)
        if factors is not _EXACT:
            speed = speed[0] / factors[0], speed[1] / factors[1], speed[2] / factors[2]
        drive.odometry = moved(odometry, speed, tick)
        is_corrected = corrected is not odometry and corrected != odometry
        drive.corrected = moved(corrected, speed, tick) if is_corrected else drive.odometry

    def _expire(self, drive: Drive, pose: Three) -> None:
        """Stop a base that was not told a speed again, or that is too far away."""
        if drive.expires is not None and self._ticks > drive.expires:
            drive.speed, drive.expires = Speed(), None
        if any(drive.speed):
            where = *pose, *drive.odometry, *(drive.corrected if drive.corrected is not drive.odometry else ())
            if max(where) > FARTHEST or min(where) < -FARTHEST:
                drive.speed, drive.expires = Speed(), None

    def _factors(self, name: str) -> Three:
        """What noise makes of the parts of a base's speed; wheels do not stand still because of it."""
        deviation = self._noise.get(name, 0.0)
        if not deviation:
            return _EXACT
        factors = (1.0 + deviation * normal(self._seed, name, "speed", self._ticks, 3)).tolist()
        ahead, aside, turn = [
            each if abs(each) >= _LEAST_FACTOR else math.copysign(_LEAST_FACTOR, each) for each in factors
        ]
        return ahead, aside, turn

    def _advance(self, base: Base, drive: Drive) -> None:
        """Move a base for a tick, unless something stops it."""
        if drive.expires is None and not any(drive.speed):
            return
        before, tick = self._pose(base.name), self._tick
        self._expire(drive, before)
        if not any(drive.speed):
            return
        factors = self._factors(base.name)
        speed = drive.speed if factors is _EXACT else Speed(*map(operator.mul, drive.speed, factors))
        if base.collides:
            depths = self._depths(base.name)
            self._place(base.name, moved(before, speed, tick))
            if any(depth < min(depths.get(pair, 0.0), 0.0) - TOUCH for pair, depth in self._depths(base.name).items()):
                self._place(base.name, before)
                return
        else:
            self._place(base.name, moved(before, speed, tick))
        is_corrected = drive.corrected is not drive.odometry
        drive.odometry = moved(drive.odometry, drive.speed, tick)
        drive.corrected = moved(drive.corrected, drive.speed, tick) if is_corrected else drive.odometry

    def _depths(self, name: str) -> dict[tuple[int, int], float]:
        """The distances of shapes of a base from shapes that stop it and are near, m; less than 0: they overlap."""
        model, data, places = self._scene.model, self._data, self._data.qpos.tobytes()
        known, found = self._deep.get(name, (b"", {}))
        if known == places:
            return found
        self._update()
        found = {}
        for one, others, reach in self._stopped(name):
            away = data.geom_xpos[others] - data.geom_xpos[one]
            for other in others[np.einsum("ij,ij->i", away, away) < reach].tolist():
                found[one, other] = mujoco.mj_geomDistance(model, data, one, other, 1.0, None)
        self._deep[name] = places, found
        return found

    def _stopped(self, name: str) -> list[tuple[int, NDArray[np.intp], Array]]:
        """The geoms of a base that are stopped, the geoms that stop them, and squares of how near they may touch."""
        if name not in self._stopping:
            own, bounds = self._scene.bases[name].shapes, self._scene.model.geom_rbound
            others = np.flatnonzero(self._scene.stops & ~own)
            mine = np.flatnonzero(self._scene.stops & own).tolist()
            self._stopping[name] = [(one, others, (bounds[one] + bounds[others]) ** 2) for one in mine]
        return self._stopping[name]
