"""How a simulated scene goes on: by physics, or as bases and joints are told."""

from __future__ import annotations

import logging
import math
import operator
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..errors import RobocompError
from ..innermodel.axes import Array
from .bases import Arc, Drive, Speed, Three, along, arc, between, extent, in_parent, moved
from .build import Base
from .falling import DEEPEST, EVERY, caught
from .joints import moved as motor_moved
from .noise import normals
from .servos import lag
from .speeds import speed_of
from .state import FARTHEST, Room, State

_LEAST_FACTOR = 0.01
"""The least part of a base's speed that noise leaves."""

TOUCH = 1e-9
"""How much deeper than before a shape of a base may be in another one, m."""

_AT_ONCE = 200
"""The most ticks for which the noise of a base is computed at once."""

_SIGHT = 1.0
"""The distance within which a base looks for obstacles, m."""

_LEAST_ROOM = 0.01
"""With less room than this, a base checks all near obstacles in each tick, m."""

_EXACT = 1.0, 1.0, 1.0
"""What no noise makes of the parts of a base's speed."""

_AT_REST = 0.0, 0.0, 0.0
"""The speed of wheels that stand still."""

_NO_ROOM = Room(0.0, 0.0)

_LEAST_WAY = 1e-12
"""What counts as the way of a base in a tick if it does not move, m."""

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
        if self._physics:
            for _ in range(count):
                self._ticks += 1
                self._act()
                if self._imus:
                    self._feel()
        else:
            self._glide(count)
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

    def _turn_joints(self, count: int = 1) -> None:
        """Turn those that have a goal, for some ticks. Those without one need not be looked at again."""
        motors, joints, tick, ahead = self._motors, self._scene.joints, self._tick, lag(self._tick)
        for name in tuple(self._busy):
            motor, joint = motors[name], joints[name]
            if motor.goal is not None:
                low, high = max(joint.low, -FARTHEST), min(joint.high, FARTHEST)
                for _ in range(count):
                    motor = motor_moved(motor, tick, low, high)
                    if motor.goal is None:
                        break
                motors[name] = motor
                if not self._physics:
                    self._places[joint.place] = joint.place_of(motor.position)
            if self._physics:
                self._data.ctrl[joint.servo] = joint.place_of(motor.position + motor.speed * ahead)
            if motor.goal is None:
                del self._busy[name]

    def _glide(self, count: int) -> None:
        """Move joints and bases for some ticks, as they are told, and compute the vector of speeds of the last one.

        Each of them moves for many ticks at once, unless something looks at the others in between.
        """
        moving = [(base, drive) for base, drive in self._driven if drive.expires is not None or any(drive.speed)]
        last = self._ticks + count
        while self._ticks < last:
            passing = min(self._at_once(moving), max(last - self._ticks - 1, 1))
            has_speeds = bool(self._imus) or self._ticks + passing == last
            before = self._data.qpos.copy() if has_speeds else None
            if self._busy:
                rooms, turns = self._rooms_now(), self._turns_obstacles()
                self._turn_joints(passing)
                self._rooms = self._data.qpos.tobytes(), {} if turns else rooms
            for base, drive in moving:
                self._advance(base, drive, passing)
            self._ticks += passing
            if before is not None:
                mujoco.mj_differentiatePos(self._scene.model, self._data.qvel, self._tick, before, self._data.qpos)
            if self._imus:
                self._feel()

    def _at_once(self, moving: Sequence[tuple[Base, Drive]]) -> int:
        """The number of ticks for which a base may move before the next one does: nothing looks at it meanwhile, and
        nothing else that moves may stop it."""
        if self._imus:
            return 1
        if not any(base.collides for base, _ in moving) or (len(moving) == 1 and not self._turns_obstacles()):
            return _AT_ONCE
        if self._turns_obstacles() or any(base.name in self._noise for base, _ in moving):
            return 1
        rooms, least, way = self._rooms_now(), math.inf, _LEAST_WAY
        for base, drive in moving:
            if any(drive.speed):
                left, reach = rooms.get(base.name, _NO_ROOM)
                away, around = extent(arc(drive.speed, self._tick))
                least, way = min(least, left), way + away + around * reach
        return int(min(max(least / way, 1.0), _AT_ONCE))

    def _turns_obstacles(self) -> bool:
        """Whether a joint that may move carries shapes that stop bases, or are stopped."""
        if not self._busy:
            return False
        if self._carriers is None:
            model, joints = self._scene.model, self._scene.joints
            carries = np.zeros(model.nbody, dtype=bool)
            carries[model.geom_bodyid[self._scene.stops]] = True
            for body in range(model.nbody - 1, 0, -1):  # parents have lower numbers
                carries[model.body_parentid[body]] |= carries[body]
            self._carriers = frozenset(name for name in joints if carries[model.dof_bodyid[joints[name].freedom]])
        return not self._carriers.isdisjoint(self._busy)

    def _act(self) -> None:
        """Let physics move everything for a tick."""
        if self._busy:
            self._turn_joints()
        places, told, noise, began = self._places, self._told, self._noise, []
        for base, drive in self._driven:
            x, z, turn = places[base.x], places[base.z], places[base.turn]
            factors: Sequence[float] = _EXACT
            if drive.expires is not None or any(drive.speed):
                self._expire(drive, (x * 1000.0, z * 1000.0, turn), self._ticks)
            if told.get(base.name) is not drive.speed or base.is_tilted or (noise and base.name in noise):
                (factors,) = self._factors(base.name, range(self._ticks, self._ticks + 1))
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
            else:
                drive.wheels = _AT_REST

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

    def _tell(self, base: Base, speed: Speed, factors: Sequence[float]) -> None:
        """Tell the servos of a base."""
        ahead, aside, turn = map(operator.mul, speed, factors)
        if base.is_tilted:
            ahead, aside = in_parent(self._pose(base), (ahead, aside, turn), self._tick)
        self._data.ctrl[base.servo : base.servo + 3] = ahead / 1000.0, aside / 1000.0, turn
        self._told[base.name] = speed

    def _roll(self, drive: Drive, before: Three, after: Three, factors: Sequence[float]) -> None:
        """Let the wheels of a base measure how it has moved in a tick; noise does `factors` to its speed."""
        if after == before:
            drive.wheels = _AT_REST
            return
        tick, odometry, corrected = self._tick, drive.odometry, drive.corrected
        speed = between(before, after, tick)
        if factors is not _EXACT:
            speed = speed[0] / factors[0], speed[1] / factors[1], speed[2] / factors[2]
        drive.wheels = speed
        drive.odometry = moved(odometry, speed, tick)
        is_corrected = corrected is not odometry and corrected != odometry
        drive.corrected = moved(corrected, speed, tick) if is_corrected else drive.odometry

    def _expire(self, drive: Drive, pose: Three, tick: int) -> None:
        """Stop a base that was not told a speed again, or that is too far away."""
        is_late = drive.expires is not None and tick > drive.expires
        if is_late or (any(drive.speed) and not _is_within(FARTHEST, pose, drive)):
            drive.speed, drive.expires = Speed(), None

    def _factors(self, name: str, ticks: range) -> Sequence[Sequence[float]]:
        """What noise makes of the three parts of a base's speed, for each tick; wheels do not stand still because of
        it. `_EXACT`: nothing."""
        deviation = self._noise.get(name, 0.0)
        if not deviation:
            return [_EXACT] * len(ticks)
        factors = 1.0 + deviation * normals(self._seed, name, "speed", ticks, 3)
        if factors.min() < _LEAST_FACTOR:
            small = np.abs(factors) < _LEAST_FACTOR
            factors[small] = np.copysign(_LEAST_FACTOR, factors[small])
        made: list[list[float]] = factors.tolist()
        return made

    def _advance(self, base: Base, drive: Drive, count: int) -> None:
        """Move a base for some ticks, unless something stops it."""
        length, told = self._tick, drive.speed
        wheels = arc(told, length)
        if self._goes_on(base, drive, count):
            moved_for = self._move(base, wheels, count)
            _roll_along(drive, wheels, moved_for)
            drive.wheels = told if moved_for == count else _AT_REST
            return
        ticks = range(self._ticks + 1, self._ticks + count + 1)
        for tick, factors in zip(ticks, self._factors(base.name, ticks), strict=True):
            self._expire(drive, self._pose(base), tick)
            if drive.speed is not told or not any(told):
                drive.wheels = drive.speed
                return
            motion = wheels
            if factors is not _EXACT:
                ahead, aside, turn = told
                motion = arc((ahead * factors[0], aside * factors[1], turn * factors[2]), length)
            moved_for = self._move(base, motion, 1)
            _roll_along(drive, wheels, moved_for)
            drive.wheels = told if moved_for else _AT_REST

    def _goes_on(self, base: Base, drive: Drive, count: int) -> bool:
        """Whether a base certainly moves on for `count` ticks: its command does not expire, and `FARTHEST` is far."""
        expires, speed = drive.expires, drive.speed
        if not any(speed) or (expires is not None and self._ticks + count > expires) or base.name in self._noise:
            return False
        way = 2000.0 * count * self._tick * max(map(abs, speed))
        return _is_within(FARTHEST - way, self._pose(base), drive)

    def _move(self, base: Base, motion: Arc, count: int) -> int:
        """Move a base for some ticks, in which nothing else moves. Returns the number of ticks until it was stopped."""
        rooms, done = self._rooms_now(), 0
        if not base.collides:
            self._follow(base, motion, count)
            self._rooms = self._data.qpos.tobytes(), {} if self._stopped(base.name) else rooms
            return count
        (left, reach), gone, (away, around) = rooms.pop(base.name, _NO_ROOM), 0.0, extent(motion)
        while done < count:
            ticks = min(count - done, int(left / max(away + around * reach, _LEAST_WAY)))  # for which there is room
            if ticks:
                self._follow(base, motion, ticks)
                left -= ticks * (away + around * reach)
            elif self._goes(base, motion):
                ticks, (left, reach) = 1, self._room_of(base)
                rooms = rooms if reach else {}  # else it is not known how far its shapes reach
            else:
                left = 0.0
                break
            done += ticks
            gone += ticks * (away + around * reach)
        rooms = {name: Room(room.left - gone, room.reach) for name, room in rooms.items() if room.left > gone}
        if left > 0.0:
            rooms[base.name] = Room(left, reach)
        self._rooms = self._data.qpos.tobytes(), rooms
        return done

    def _follow(self, base: Base, motion: Arc, count: int) -> None:
        """Move a base that nothing stops for some ticks."""
        places = self._places
        before = (places[base.x], places[base.z], places[base.turn])
        places[base.x], places[base.z], places[base.turn] = along(before, motion, count, unit=1000.0)

    def _rooms_now(self) -> dict[str, Room]:
        """The rooms of bases, as far as they are known where all is now."""
        places, rooms = self._rooms
        return dict(rooms) if places == self._data.qpos.tobytes() else {}

    def _goes(self, base: Base, motion: Arc) -> bool:
        """Move a base for a tick, unless something stops it."""
        depths, before = self._depths(base.name), self._pose(base)
        self._place(base, along(before, motion))
        if any(depth < min(depths.get(pair, 0.0), 0.0) - TOUCH for pair, depth in self._depths(base.name).items()):
            self._place(base, before)
            return False
        return True

    def _room_of(self, base: Base) -> Room:
        """How far a base may move from where it is, in any direction, before it can touch an obstacle."""
        nearest = min(self._depths(base.name).values(), default=_SIGHT)
        if nearest < _LEAST_ROOM:
            return _NO_ROOM
        data, bounds, reach = self._data, self._scene.model.geom_rbound, 0.0
        middle = data.xpos[self._scene.frames[base.name].body]
        for one, others, touching in self._stopped(base.name):
            away = data.geom_xpos[others] - data.geom_xpos[one]
            far = np.sqrt(np.einsum("ij,ij->i", away, away)) - np.sqrt(touching)
            nearest = min(nearest, float(far[far >= 0.0].min(initial=_SIGHT)))
            reach = max(reach, float(np.linalg.norm(data.geom_xpos[one] - middle) + bounds[one]))
        return Room(max(nearest - _LEAST_ROOM / 2, 0.0), reach)

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
                found[one, other] = mujoco.mj_geomDistance(model, data, one, other, _SIGHT, None)
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


def _roll_along(drive: Drive, wheels: Arc, count: int) -> None:
    """Let the wheels of a base measure how it has moved for some ticks."""
    odometry = along(drive.odometry, wheels, count)
    is_corrected = drive.corrected is not drive.odometry
    drive.corrected = along(drive.corrected, wheels, count) if is_corrected else odometry
    drive.odometry = odometry


def _is_within(most: float, pose: Three, drive: Drive) -> bool:
    """Whether a base is nowhere beyond `most`, mm or rad: neither where it is, nor where it believes to be."""
    return (
        _is_near(most, pose)
        and _is_near(most, drive.odometry)
        and (drive.corrected is drive.odometry or _is_near(most, drive.corrected))
    )


def _is_near(most: float, pose: Three) -> bool:
    x, z, turn = pose
    return -most <= x <= most and -most <= z <= most and -most <= turn <= most
