"""A simulated scene: it goes on in ticks, and is the same every time.

With physics off, bases and joints move as they are told, and all else stays where it is. With physics on, bodies have
weight, shapes are solid, and motors have to move them.

Lengths are in mm, angles in rad, times in s; axes are those of InnerModel: x to the right, y up, z ahead, and turns to
the right. The state is all in a `World`, so its copy is a world of its own, which goes on in the same way.
"""

from __future__ import annotations

import copy
import hashlib
import logging
import math
import operator
import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..errors import RobocompError
from ..innermodel import axes
from ..innermodel.axes import Array
from ..innermodel.camera import Lens
from ..innermodel.pictures import MOST_SHOWN, Pixels
from ..innermodel.read import ROOT_ID, InnerModelError
from ..innermodel.tree import Tree
from ..spelling import unknown
from .bases import Drive, Pose, Speed, Three, between, in_parent, moved
from .build import Base, Scene, build, rebuilt
from .devices.imu import Inertia, Inertial
from .devices.imu import read as read_imu
from .devices.laser import Laser
from .devices.lidar import Lidar, is_lidar
from .devices.touch import Touch
from .edits import carry, fingerprint
from .falling import DEEPEST, EVERY, caught, let_go
from .grippers import hold, nearest
from .joints import At, Motor, To
from .joints import moved as motor_moved
from .looks import cameras, lens_of
from .noise import normal
from .parameters import Parameters
from .render import View
from .servos import lag
from .speeds import Truth, speed_of, truth, update_speeds

TICK = 0.005
"""Length of a tick, s."""

HOLD = 1.0
"""How long a base goes on at a speed that it was told, s."""

_LEAST_FACTOR = 0.01
"""The least part of a base's speed that noise leaves."""

_TOUCH = 1e-9
"""How much deeper than before a shape of a base may be in another one, m."""

_EXACT = 1.0, 1.0, 1.0
"""What no noise makes of the parts of a base's speed."""

_FARTHEST = 1e9
"""mm or rad, also a second: a base does not go on beyond this, 1000 km."""

_BAD_POSITION = int(mujoco.mjtWarning.mjWARN_BADQPOS)
_BAD_VELOCITY = int(mujoco.mjtWarning.mjWARN_BADQVEL)
_BAD_ACCELERATION = int(mujoco.mjtWarning.mjWARN_BADQACC)

T = TypeVar("T")

log = logging.getLogger("robocomp.sim")

_logging = mujoco.MjLogConfig.get()
_logging.logto_file = False  # of warnings, into the folder of whatever imports this: exceptions tell them
_logging.set()


class SimulationError(RobocompError):
    """Physics has no result for a scene: its state is no longer one that could be."""


@dataclass(frozen=True, slots=True, eq=False)
class Saved:
    """The state of a world at a moment; see `World.save`."""

    world: World


class Contact(NamedTuple):
    """Two shapes that touch."""

    one: str
    other: str
    force: float
    """With which they press on each other, N."""
    position: Array
    """Seen from the root, shape (3,), mm."""


class Overlap(RobocompError):
    """A base that stops before shapes would be inside of one."""


class World:
    """A scene and its state. One thread uses it at a time."""

    def __init__(
        self,
        tree: Tree,
        *,
        seed: int = 0,
        tick: float = TICK,
        hold: float = HOLD,
        without_meshes: bool = False,
        physics: bool = False,
        parameters: Parameters | None = None,
        compat: Literal["", "robocomp"] = "",
    ) -> None:
        """Begin with all as the tree has it.

        A base stops `hold` seconds after it was last told a speed; 0: never. About `parameters` see
        `sim.parameters`. With `compat="robocomp"`, the acceleration of inertial units has the sign that it has in
        RoboComp: -9.81 upwards at rest. Raises InnerModelError for a mesh or a sensor that cannot be used, and for
        wrong parameters.
        """
        if not tick > 0.0 or not hold >= 0.0:
            raise ValueError(f"a tick of {tick} s, and a hold of {hold} s")
        if compat not in ("", "robocomp"):
            raise ValueError(f"compat={compat!r}: it is `robocomp`, or nothing")
        self._tree, self._seed, self._tick = tree.copy(), seed, tick
        self._hold = round(hold / tick)
        self._without_meshes, self._parameters = without_meshes, dict(parameters or {})
        self._lasers: dict[str, Laser] = {}
        self._equip(self._parameters)
        self._original: Tree | None = None
        """The tree before the first change."""
        self._edits: bytes | None = b""
        """The fingerprint of the tree, if it differs from that one; None: not yet computed."""
        self._shown: dict[str, Pixels] = {}
        self._held: dict[str, str] = {}
        self._use(mujoco.MjData(self._scene.model))
        self._ticks = 0
        self._physics, self._compat = physics, compat
        self._has_speeds = False
        self._inertias: dict[str, Inertia] = {}
        self._drives: dict[str, Drive] = {}
        self._motors: dict[str, Motor] = {}
        self._noise: dict[str, float] = {}
        self._busy: dict[str, None] = {}
        """The joints that a tick looks at: they have a goal, or their servo was not told where they are."""
        self._told: dict[str, Speed] = {}
        """What the servos of bases were told last: it is still in the vector of controls."""
        self.reset(seed)

    def _use(self, data: mujoco.MjData) -> None:
        """Keep the state there."""
        self._data = data
        self._places: memoryview[Any] = memoryview(data.qpos)
        """Of the same numbers as the vector of positions, and quicker where few of them are needed."""
        self._warnings: memoryview[Any] = memoryview(data.warning.number)

    def _equip(self, parameters: Parameters, before: Scene | None = None) -> None:
        """Make the model of the tree, from the scene before it if that is enough, and the devices in it."""
        tree, lasers = self._tree, self._lasers
        made = rebuilt(before, tree, parameters) if before else None
        self._scene: Scene = made or build(tree, self._tick, without_meshes=self._without_meshes, parameters=parameters)
        tags = tree.tags
        self._lasers = {
            name: lasers[name] if before and self._is_kept(name, before) else Laser(node, self._scene.frames[name])
            for name, tag in tags.items()
            if tag == "laser" and (node := tree.node(name)).values["measures"] != 0
        }
        self._lidars = {
            name: Lidar(tree.node(name), self._scene.frames[name], parameters[name])
            for name in self._lasers
            if is_lidar(parameters.get(name, {}))
        }
        self._movable = list(self._scene.movable)
        self._stopping: dict[str, list[tuple[int, NDArray[np.intp], Array]]] = {}
        self._deep: dict[str, tuple[bytes, dict[tuple[int, int], float]]] = {}
        """By base: the vector of positions when `_depths` were computed last, and what they were."""
        self._free = np.flatnonzero(self._scene.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        self._lenses = {name: lens_of(tree.node(name)) for name in cameras(tree)}
        self._displays = dict.fromkeys(name for name, tag in tags.items() if tag == "display")
        self._imus = {name: self._scene.frames[name] for name, tag in tags.items() if tag == "imu"}
        self._touches = {name: Touch(tree, name, self._scene) for name, tag in tags.items() if tag == "touchsensor"}
        if self._scene.grippers or any(touch.needs_waking for touch in self._touches.values()):
            self._scene.model.tree_sleep_policy[:] = mujoco.mjtSleepPolicy.mjSLEEP_NEVER

    def _is_kept(self, name: str, before: Scene) -> bool:
        """Whether a node is where it was in the scene before, and what it was."""
        is_there = before.frames.get(name) is self._scene.frames[name]
        return is_there and before.tree.node(name) == self._tree.node(name)

    def reset(self, seed: int | None = None) -> None:
        """Begin again at tick 0, with all as the tree had it; with another seed if one is given.

        Physics stays on or off.
        """
        self._seed = self._seed if seed is None else seed
        mujoco.mj_resetData(self._scene.model, self._data)
        self._data.qpos[:] = self._scene.start
        self._ticks, self._told = 0, {}
        self._set_motors({name: Motor(self.position(name)) for name in self._scene.joints})
        self._inertias = dict.fromkeys(self._imus, Inertia())
        self._noise = self._usual_noise()
        self._shown, self._held = {}, {}
        self._set_drives({name: self._resting(name) for name in self._scene.bases})
        self._update()

    def _usual_noise(self) -> dict[str, float]:
        """What the file says of noise."""
        found = {name: base.noise for name, base in self._scene.bases.items() if base.noise}
        for name in self._lenses:
            noise = float(str(self._tree.node(name).values.get("noise", 0.0)))
            found |= {name: noise} if noise else {}
        return found

    def change(self, tree: Tree, placed: Mapping[str, Array] | None = None) -> None:
        """Go on with another tree, which is not to be changed afterwards: start from a copy of `tree`.

        Everything that both trees have keeps its place and its state, and new nodes begin as the tree has them. Bases
        and free bodies are moved to where `placed` has them, as poses within their parents, shape (4, 4), mm. Raises
        InnerModelError for what cannot be used, and Overlap if a base that stops would be inside of what stops it;
        then nothing has changed.
        """
        overlaps = self._overlaps()
        before = object.__new__(World)  # with the same data: the edited world gets others
        before.__dict__.update(self.__dict__)
        parameters = {name: values for name, values in self._parameters.items() if name in tree}
        try:
            self._tree = tree
            self._equip(parameters, before._scene)
            self._use(mujoco.MjData(self._scene.model))
            self._data.qpos[:] = self._scene.start
            carry(before._scene, before._data, self._scene, self._data)
            self._told = {}
            self._update()
            for name, pose in (placed or {}).items():
                self._set_pose(name, pose)
            self._keep(before)
            for (one, other), depth in self._overlaps().items():
                if depth < overlaps.get((one, other), 0.0) - _TOUCH:
                    raise Overlap(f"`{one}` would be {-depth * 1000:.1f} mm deep in `{other}`")
        except BaseException:
            self.__dict__ = before.__dict__
            raise
        self._original, self._edits = before._original or before._tree, None

    def _keep(self, before: World) -> None:
        """Take over what was told before, as far as it is about nodes that are still there."""
        noise = self._usual_noise()
        for name in {**self._scene.bases, **self._lasers, **self._imus, **self._lenses}:
            if name in before._tree and (name in before._noise or name in noise):
                noise[name] = before._noise.get(name, 0.0)
        self._noise = noise
        self._shown = {name: pixels for name, pixels in before._shown.items() if name in self._displays}
        self._inertias = {name: before._inertias.get(name, Inertia()) for name in self._imus}
        grippers = self._scene.grippers
        held = {name: body for name, body in before._held.items() if name in grippers and body in grippers[name].welds}
        self._held = held
        self._held = {}
        for name, body in before._held.items():
            if name in self._scene.grippers and body in self._scene.grippers[name].welds:
                self._attach(name, body)
        drives = {name: self._resting(name) for name in self._scene.bases}
        self._set_drives({name: before._drives.get(name, new) for name, new in drives.items()})
        motors = {name: Motor(self.position(name)) for name in self._scene.joints}
        kept = {name for name, joint in self._scene.joints.items() if _slides(before, name) == joint.slides}
        self._set_motors({name: before._motors[name] if name in kept else new for name, new in motors.items()})

    def _set_pose(self, name: str, pose: Array) -> None:
        """Put a base, or a free body, where a pose within its parent says, at rest."""
        node, model = self._tree.node(name), self._scene.model
        if name in self._scene.bases:
            tilt, roll = (float(str(node.values[each])) for each in ("rx", "rz"))
            turned = axes.rotation(tilt, 0.0, 0.0).T @ pose[:3, :3] @ axes.rotation(0.0, 0.0, roll).T
            self._place(name, Pose(float(pose[0, 3]), float(pose[2, 3]), math.atan2(turned[0, 2], turned[0, 0])))
            self._data.qvel[[model.jnt_dofadr[model.joint(f".{name}.{each}").id] for each in ("x", "z", "turn")]] = 0.0
        else:
            joint = model.joint(f".{name}")
            world = self._matrix(node.parent) @ pose
            place, freedom = int(joint.qposadr[0]), int(joint.dofadr[0])
            self._data.qpos[place : place + 3] = axes.position_to_simulation(world[:3, 3])
            turn = axes.rotation_to_simulation(world[:3, :3])
            mujoco.mju_mat2Quat(self._data.qpos[place + 3 : place + 7], turn.ravel())
            self._data.qvel[freedom : freedom + 6] = 0.0
            let_go(model, self._data, joint.id)
        self._update()

    def _overlaps(self) -> dict[tuple[str, str], float]:
        """How far shapes of bases are inside of shapes that stop them, m, less than 0; by the ids of the shapes."""
        self._update()
        shapes, found = self._scene.shapes, {}
        for name, base in self._scene.bases.items():
            for (one, other), depth in self._depths(name).items() if base.collides else ():
                if depth < 0.0:
                    found[shapes[one], shapes[other]] = depth
        return found

    @property
    def tree(self) -> Tree:
        """What it was made of: what moves is where it began. It is not to be changed; see `change`."""
        return self._tree

    def collide(self, one: str, other: str) -> bool:
        """Whether a shape at or below one node is inside of one at or below another; a mesh counts as its hull.

        What is below both counts for the second. Raises InnerModelError if there is no such node.
        """
        theirs = self._below(other)
        mine = self._below(one) - theirs
        model, data, shapes = self._scene.model, self._data, self._scene.shapes
        first = [number for number, name in enumerate(shapes) if name in mine]
        second = [number for number, name in enumerate(shapes) if name in theirs]
        for each in first:
            apart = np.linalg.norm(data.geom_xpos[second] - data.geom_xpos[each], axis=1)
            reach = model.geom_rbound[each] + model.geom_rbound[second]
            for near in np.array(second, dtype=int)[apart < reach].tolist():
                if mujoco.mj_geomDistance(model, data, each, near, 1.0, None) < 0.0:
                    return True
        return False

    def _below(self, name: str) -> set[str]:
        """A node and all below it."""
        _known("node", name, self._scene.frames)
        found, waiting = set(), [name]
        while waiting:
            found.add(name := waiting.pop())
            waiting += self._tree.node(name).children
        return found

    def copy(self) -> World:
        """A world with the same state, which goes on by itself."""
        made = object.__new__(World)
        made.__dict__.update(self.__dict__)
        if self._scene.grippers:
            made._scene = replace(self._scene, model=copy.copy(self._scene.model))
        made._use(mujoco.MjData(made._scene.model))
        made._take(self)
        return made

    def save(self) -> Saved:
        """Keep the state of now, for `restore`. It takes as much memory as a copy, for as long as it is held."""
        return Saved(self.copy())

    def restore(self, saved: Saved) -> None:
        """Go on from a saved state: with the same commands, it ends in the same bits again.

        A state may be restored many times. Raises ValueError for the state of a world that is not this one or a copy
        of it.
        """
        if saved.world._scene.frames is not self._scene.frames:
            raise ValueError("the saved state is that of another scene")
        self._take(saved.world)

    def _take(self, other: World) -> None:
        """Take over the whole state of a world with the same scene.

        The data are copied whole: a vector of the state does not tell which bodies sleep.
        """
        mujoco.mj_copyData(self._data, self._scene.model, other._data)
        self._told, self._busy = dict(other._told), dict(other._busy)
        self._ticks, self._seed, self._physics = other._ticks, other._seed, other._physics
        self._has_speeds = other._has_speeds
        self._set_drives({name: replace(drive) for name, drive in other._drives.items()})
        self._motors, self._noise, self._shown = dict(other._motors), dict(other._noise), dict(other._shown)
        self._inertias, self._held = dict(other._inertias), dict(other._held)
        if self._held:  # where a gripper holds a body is part of its model
            self._scene.model.eq_data[:] = other._scene.model.eq_data

    @property
    def tick(self) -> float:
        """The length of a tick, s."""
        return self._tick

    @property
    def ticks(self) -> int:
        """The number of ticks since the beginning."""
        return self._ticks

    @property
    def time(self) -> float:
        """Seconds since the beginning."""
        return self._ticks * self._tick

    @property
    def physics(self) -> bool:
        """Whether bodies have weight and shapes are solid."""
        return self._physics

    def set_physics(self, on: bool) -> None:
        """Switch physics on or off. All is where it was, and at rest; joints that move go on, and grippers let go."""
        if on == self._physics:
            return
        for gripper in list(self._held):
            self.release(gripper)
        self._physics = on
        self._data.qvel[:] = 0.0
        self._inertias = {name: inertia._replace(velocity=(0.0, 0.0, 0.0)) for name, inertia in self._inertias.items()}
        self._set_motors({name: motor._replace(position=self.position(name)) for name, motor in self._motors.items()})

    @property
    def bases(self) -> list[str]:
        return list(self._scene.bases)

    @property
    def joints(self) -> list[str]:
        return list(self._scene.joints)

    @property
    def lasers(self) -> list[str]:
        return list(self._lasers)

    @property
    def lidars(self) -> list[str]:
        """The lasers with the parameter `fans` or `field`; see `cloud`."""
        return list(self._lidars)

    @property
    def movable(self) -> list[str]:
        """The nodes that can move within their parents: bases, joints, and bodies that move freely."""
        return list(self._movable)

    @property
    def cameras(self) -> list[str]:
        """The nodes `rgbd` and `camera`; see `view`."""
        return list(self._lenses)

    @property
    def displays(self) -> list[str]:
        return list(self._displays)

    @property
    def grippers(self) -> list[str]:
        """The nodes with the parameter `suction`."""
        return list(self._scene.grippers)

    @property
    def imus(self) -> list[str]:
        return list(self._imus)

    @property
    def touch_sensors(self) -> list[str]:
        return list(self._touches)

    def digest(self) -> str:
        """A hash of the whole state: worlds with the same one go on alike, if they are told the same."""
        made = hashlib.sha256(struct.pack("<qq?", self._ticks, self._seed, self._physics))
        data = self._data
        for array in (data.qpos, data.qvel, data.ctrl, data.qacc_warmstart, data.tree_asleep, data.eq_active):
            made.update(array.tobytes())
        for name, drive in sorted(self._drives.items()):
            numbers = (*drive.speed, *drive.odometry, *drive.corrected)
            made.update(f"{name}{drive.expires}".encode() + struct.pack("<9d", *numbers))
        if self._edits is None and self._original:
            now = fingerprint(self._tree)
            self._edits = now if now != fingerprint(self._original) else b""
        made.update(self._edits or b"")
        for weld in self._welds():
            made.update(self._scene.model.eq_data[weld].tobytes())
        for values in (self._motors, self._noise, self._inertias, self._held):
            made.update(repr(sorted(values.items())).encode())
        for name, pixels in sorted(self._shown.items()):
            made.update(f"{name}{pixels.shape}".encode() + pixels.tobytes())
        return made.hexdigest()

    # What robots are told.

    def drive(self, base: str, ahead: float = 0.0, aside: float = 0.0, turn: float = 0.0) -> None:
        """Drive at mm/s and rad/s. A base with two wheels does not move aside.

        Raises InnerModelError if there is no such base, and ValueError for speeds that no robot has.
        """
        found = _known("base", base, self._scene.bases)
        speed = Speed(*_near("speed", ahead, aside if found.is_omni else 0.0, turn))
        drive = self._drives[base]
        drive.speed, drive.expires = speed, self._ticks + self._hold if self._hold else None

    def move_joint(self, joint: str, position: float, speed: float = 0.0) -> float:
        """Move a joint to a position in rad, or mm if it slides, at rad/s or mm/s; a speed of 0: at once.

        With physics on, at once is as fast as its motor can. Returns where it will end, within its limits. Raises
        InnerModelError if there is no such joint, and ValueError for numbers that are not finite, or too large for
        messages.
        """
        self.move_joints({joint: (position, speed)})
        found = self._scene.joints[joint]
        return min(max(float(position), found.low), found.high)

    def move_joints(self, goals: Mapping[str, tuple[float, float]]) -> None:
        """Move joints to positions at speeds. If it raises what `move_joint` raises, none has moved."""
        known = {name: _known("joint", name, self._scene.joints) for name in goals}
        checked = {name: _near("position", *goal) for name, goal in goals.items()}
        for name, (position, speed) in checked.items():
            position = min(max(position, known[name].low), known[name].high)
            if speed == 0.0:
                self._hold_joint(name, Motor(position))
            else:
                self._set_motor(name, self._motors[name]._replace(goal=To(position, abs(speed))))
        self._update()

    def drive_joint(self, joint: str, speed: float, acceleration: float = 0.0) -> None:
        """Move a joint at a speed, rad/s or mm/s, until it is told otherwise or reaches a limit.

        Its speed changes by at most `acceleration` per second; 0: at once. Raises as `move_joint` does.
        """
        self.drive_joints({joint: (speed, acceleration)})

    def drive_joints(self, goals: Mapping[str, tuple[float, float]]) -> None:
        """Move joints at speeds, with accelerations. If it raises what `move_joint` raises, none has changed."""
        for name in goals:
            _known("joint", name, self._scene.joints)
        checked = {name: _near("speed", *goal) for name, goal in goals.items()}
        for name, (speed, acceleration) in checked.items():
            self._set_motor(name, self._motors[name]._replace(goal=At(speed, abs(acceleration))))

    def grip(self, gripper: str) -> str:
        """Switch a suction cup or magnet on: it holds the nearest body that it reaches, where it is.

        Returns the id of the body that it holds; "" if it reaches none, or physics is off. One that holds a body keeps
        it. Raises InnerModelError if there is no such gripper.
        """
        found = _known("gripper", gripper, self._scene.grippers)
        if gripper not in self._held and self._physics:
            body = nearest(found, self._scene.model, self._data)
            if body:
                self._attach(gripper, body)
        return self.held(gripper)

    def _attach(self, gripper: str, body: str) -> None:
        hold(self._scene.model, self._data, self._scene.grippers[gripper].welds[body])
        self._held[gripper] = body

    def release(self, gripper: str) -> None:
        """Switch a suction cup or magnet off."""
        found = _known("gripper", gripper, self._scene.grippers)
        if gripper in self._held:
            self._data.eq_active[found.welds[self._held.pop(gripper)]] = 0

    def held(self, gripper: str) -> str:
        """The id of the body that a gripper holds; "" if it holds none."""
        _known("gripper", gripper, self._scene.grippers)
        return self._held.get(gripper, "")

    def set_odometry(
        self, base: str, x: float = 0.0, z: float = 0.0, turn: float = 0.0, corrected: Pose | None = None
    ) -> None:
        """Let the odometry go on from another pose, mm and rad, and its correction from `corrected` or from there."""
        drive, pose = self._drive(base), Pose(*_near("pose", x, z, turn))
        drive.corrected = Pose(*_near("pose", *corrected)) if corrected else pose
        drive.odometry = pose

    def correct_odometry(self, base: str, x: float, z: float, turn: float) -> None:
        """Tell where the base is, mm and rad: `corrected` goes on from there."""
        self._drive(base).corrected = Pose(*_near("pose", x, z, turn))

    def reset_imu(self, imu: str) -> None:
        """Let the present yaw of an inertial unit be 0."""
        _known("imu", imu, self._imus)
        yaw = self._inertias[imu].yaw + self.inertial(imu).yaw
        self._inertias[imu] = self._inertias[imu]._replace(yaw=yaw)

    def set_noise(self, node: str, deviation: float) -> None:
        """Set the standard deviation of what disturbs a node.

        Of a laser, mm; of an inertial unit, m/s² and rad/s; of a base, a factor of its speed; of an rgbd, a factor of
        its depths.
        """
        disturbed = {**self._scene.bases, **self._lasers, **self._imus, **self._lenses}
        _known("laser, imu, base or rgbd", node, disturbed)
        (deviation,) = _finite("standard deviation", deviation)
        if deviation < 0.0:
            raise ValueError(f"a standard deviation of {deviation}")
        self._noise[node] = deviation

    def show(self, display: str, pixels: Pixels | None) -> None:
        """Let a display show a picture: red, green and blue, rows from the top, shape (height, width, 3); None: its
        colour. It is seen from now on, by every camera.

        Raises InnerModelError if there is no such display, and ValueError for what is no picture.
        """
        _known("display", display, self._displays)
        if pixels is None:
            self._shown.pop(display, None)
        elif pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size:
            raise ValueError(f"{pixels.dtype} of shape {pixels.shape}: a picture has uint8 of (height, width, 3)")
        elif max(pixels.shape) > MOST_SHOWN:
            raise ValueError(f"a display shows at most {MOST_SHOWN} rows and columns, not {pixels.shape[:2]}")
        else:
            self._shown[display] = pixels.copy()

    # How things are.

    def odometry(self, base: str) -> Pose:
        """Where a base is by its wheels. It begins at the pose of the file."""
        return self._drive(base).odometry

    def corrected(self, base: str) -> Pose:
        """The last pose that the base was told, moved on by its wheels."""
        return self._drive(base).corrected

    def speed(self, base: str) -> Speed:
        """What the base does, without its noise."""
        return self._drive(base).speed

    def position(self, joint: str) -> float:
        """Of a joint: rad, or mm if it slides."""
        found = _known("joint", joint, self._scene.joints)
        place = float(self._data.qpos[found.place])
        return (place - found.offset) * 1000.0 if found.slides else place

    def joint_speed(self, joint: str) -> float:
        """Of a joint: rad/s, or mm/s if it slides."""
        found = _known("joint", joint, self._scene.joints)
        if not self._physics:
            return self._motors[joint].speed
        speed = float(self._data.qvel[found.freedom])
        return speed * 1000.0 if found.slides else speed

    def matrix(self, node: str, seen_from: str = ROOT_ID) -> Array:
        """The true pose of a node, shape (4, 4): from `node` to `seen_from`, lengths in mm."""
        found = self._matrix(node)
        if seen_from == ROOT_ID:
            return found
        made: Array = axes.inverse(self._matrix(seen_from)) @ found
        return made

    def poses(self) -> Array:
        """The poses of all `movable` nodes, seen from the root: shape (n, 4, 4), mm."""
        frames = [self._scene.frames[name] for name in self._movable]
        bodies = [frame.body for frame in frames]
        made = np.zeros((len(frames), 4, 4))
        if not frames:
            return made
        turns = self._data.xmat[bodies].reshape(-1, 3, 3)
        away = turns @ np.array([frame.position for frame in frames])[:, :, None]
        made[:, :3, :3] = axes.rotation_from_simulation(turns @ np.array([frame.rotation for frame in frames]))
        made[:, :3, 3] = axes.position_from_simulation(self._data.xpos[bodies] + away[..., 0])
        made[:, 3, 3] = 1.0
        return made

    def scan(self, laser: str) -> Array:
        """The distances that a laser measures now, mm, shape (measures,), from the right to the left."""
        found = _known("laser", laser, self._lasers)
        deviation = self._noise.get(laser, 0.0)
        noise = None
        if deviation:
            noise = deviation * normal(self._seed, laser, "distance", self._ticks, len(found.angles))
        return found.scan(self._scene.model, self._data, noise)

    def angles(self, laser: str) -> Array:
        """Of a laser's rays, rad to the right, shape (measures,)."""
        return _known("laser", laser, self._lasers).angles

    def cloud(self, lidar: str) -> Array:
        """The points that a lidar measures now, within its node: mm, shape (n, 3).

        They are sorted by their direction, from the left to the right. Noise is along the rays.
        """
        found = _known("lidar", lidar, self._lidars)
        deviation = self._noise.get(lidar, 0.0)
        noise = deviation * normal(self._seed, lidar, "cloud", self._ticks, found.count) if deviation else None
        return found.cloud(self._scene.model, self._data, noise)

    def lens(self, camera: str) -> Lens:
        """The size of a camera's pictures, and its focal length; pixels."""
        return _known("camera", camera, self._lenses)

    def view(self) -> View:
        """All that cameras see of the world as it is now. `Renderer.picture` draws it, in any thread."""
        noise = {name: self._noise[name] for name in self._lenses if name in self._noise}
        return View(self._scene, self._data.qpos.copy(), self._seed, self._ticks, noise, dict(self._shown))

    def inertial(self, imu: str) -> Inertial:
        """What an inertial unit measures now. Its yaw is 0 where `reset_imu` was called, and ahead before."""
        found = _known("imu", imu, self._imus)
        self._update_speeds()
        inertia, deviation = self._inertias[imu], self._noise.get(imu, 0.0)
        made = read_imu(self._scene.model, self._data, found, np.array(inertia.acceleration))
        made = made._replace(yaw=math.remainder(made.yaw - inertia.yaw, math.tau))
        if deviation:
            noise = deviation * normal(self._seed, imu, "inertia", self._ticks, 6)
            made = made._replace(acceleration=made.acceleration + noise[:3], gyroscope=made.gyroscope + noise[3:])
        return made._replace(acceleration=-made.acceleration) if self._compat else made

    def touch(self, sensor: str) -> float:
        """The force in N that pressed on a sensor of touch in the last tick, between its limits; of a bumper, 1 or 0.

        The force is that along its normal, positive against it; without a normal, its size. With physics off, it is 1
        while something overlaps the sensor, and else 0.
        """
        found = _known("sensor of touch", sensor, self._touches)
        return (found.read if self._physics else found.overlaps)(self._scene.model, self._data)

    def truth(self, node: str) -> Truth:
        """Where any node is and how it moves, in m and rad, seen from the root."""
        found = _known("node", node, self._scene.frames)
        self._update_speeds()
        return truth(self._scene.model, self._data, found)

    def contacts(self) -> list[Contact]:
        """What touches, and how hard, while physics is on: in the last tick, and of bodies that sleep, now."""
        found = [self._contact(self._data, number) for number in self._pressing(self._data)]
        if self._physics and (self._data.tree_asleep >= 0).any():
            awake = mujoco.MjData(self._scene.model)
            awake.qpos[:] = self._data.qpos
            mujoco.mj_forward(self._scene.model, awake)
            trees = self._scene.model.body_treeid[self._scene.model.geom_bodyid[awake.contact.geom]]
            sleeps = (self._data.tree_asleep[trees] >= 0) | (trees < 0)
            found += [self._contact(awake, number) for number in self._pressing(awake) if sleeps[number].all()]
        return sorted(found, key=lambda each: (each.one, each.other))

    def touching(self) -> list[tuple[str, str]]:
        """The pairs of shapes that touched in the last tick, each once; without those of bodies that sleep."""
        shapes, pressing = self._scene.shapes, self._pressing(self._data)
        if not pressing:
            return []
        pairs = {tuple(pair) for pair in self._data.contact.geom[pressing].tolist()}
        return sorted((min(shapes[a], shapes[b]), max(shapes[a], shapes[b])) for a, b in pairs)

    def distance(self, one: str, other: str) -> float:
        """The least distance of the shapes at or below two nodes, mm; less than 0: they overlap. A mesh is its hull.

        Raises InnerModelError for a node that is not there, or has no shapes.
        """
        model, data = self._scene.model, self._data
        mine, others = self._shapes_of(one), self._shapes_of(other)
        found = min(mujoco.mj_geomDistance(model, data, a, b, _FARTHEST, None) for a in mine for b in others)
        return float(found) * 1000.0

    # How it goes on.

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
        for name in tuple(self._busy):
            motor, joint = self._motors[name], self._scene.joints[name]
            if motor.goal is not None:
                low, high = max(joint.low, -_FARTHEST), min(joint.high, _FARTHEST)
                motor = motor_moved(motor, self._tick, low, high)
                self._hold_joint(name, motor)
            if self._physics:
                self._data.ctrl[joint.servo] = joint.place_of(motor.position + motor.speed * lag(self._tick))
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
            text = "`%s` has fallen %g m below the scene after %.1f s, and stays there"
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
            if max(where) > _FARTHEST or min(where) < -_FARTHEST:
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
            if any(depth < min(depths.get(pair, 0.0), 0.0) - _TOUCH for pair, depth in self._depths(base.name).items()):
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

    def _pose(self, base: str) -> Pose:
        found, places = self._scene.bases[base], self._places
        return Pose(places[found.x] * 1000.0, places[found.z] * 1000.0, places[found.turn])

    def _resting(self, base: str) -> Drive:
        """Of a base that is told nothing, and believes to be where it is."""
        pose = self._pose(base)
        return Drive(Speed(), None, pose, pose)

    def _place(self, base: str, pose: Pose) -> None:
        found, places = self._scene.bases[base], self._places
        places[found.x], places[found.z], places[found.turn] = pose.x / 1000.0, pose.z / 1000.0, pose.turn

    def _set_drives(self, drives: dict[str, Drive]) -> None:
        self._drives = drives
        self._driven = [(self._scene.bases[name], drive) for name, drive in drives.items()]
        """The same with their bases, for each tick."""

    def _set_motors(self, motors: dict[str, Motor]) -> None:
        self._motors, self._busy = motors, dict.fromkeys(motors)

    def _set_motor(self, name: str, motor: Motor) -> None:
        self._motors[name] = motor
        self._busy[name] = None

    def _hold_joint(self, name: str, motor: Motor) -> None:
        """Let a joint be where its motor is; with physics on, its servo leads it there."""
        self._set_motor(name, motor)
        if not self._physics:
            joint = self._scene.joints[name]
            self._places[joint.place] = joint.place_of(motor.position)

    def _update(self) -> None:
        mujoco.mj_kinematics(self._scene.model, self._data)
        self._has_speeds = False

    def _update_speeds(self) -> None:
        if not self._has_speeds:
            update_speeds(self._scene.model, self._data)
            self._has_speeds = True

    def _welds(self) -> list[int]:
        """The numbers of the welds that hold something."""
        return [self._scene.grippers[name].welds[body] for name, body in sorted(self._held.items())]

    def _pressing(self, data: mujoco.MjData) -> list[int]:
        """The numbers of contacts that have a force."""
        if not self._physics or not data.ncon:
            return []
        return np.flatnonzero(data.contact.efc_address >= 0).tolist()

    def _contact(self, data: mujoco.MjData, number: int) -> Contact:
        contact, pressed = data.contact[number], np.empty(6)
        mujoco.mj_contactForce(self._scene.model, data, number, pressed)
        one, other = sorted(self._scene.shapes[each] for each in contact.geom)
        return Contact(one, other, float(np.linalg.norm(pressed[:3])), axes.position_from_simulation(contact.pos))

    def _shapes_of(self, name: str) -> list[int]:
        """The geoms at or below a node."""
        below = self._below(name)
        found = [number for number, shape in enumerate(self._scene.shapes) if shape in below]
        if not found:
            raise InnerModelError(f"`{name}` has no shapes, so it has no distance from anything")
        return found

    def _matrix(self, name: str) -> Array:
        frame = _known("node", name, self._scene.frames)
        turn = self._data.xmat[frame.body].reshape(3, 3)
        position = axes.position_from_simulation(self._data.xpos[frame.body] + turn @ frame.position)
        return axes.pose(position.tolist(), axes.rotation_from_simulation(turn @ frame.rotation))

    def _drive(self, base: str) -> Drive:
        _known("base", base, self._scene.bases)
        return self._drives[base]


def _slides(world: World, joint: str) -> bool | None:
    """Whether a joint slides; None for a node that is not a joint."""
    found = world._scene.joints.get(joint)
    return found.slides if found else None


def _known(kind: str, name: str, among: Mapping[str, T]) -> T:
    try:
        return among[name]
    except KeyError:
        raise InnerModelError(unknown(kind, name, among)) from None


def _near(what: str, *numbers: float) -> tuple[float, ...]:
    """Numbers that messages can carry, too: some interfaces have whole numbers of mm, and floats of 32 bits."""
    for each in _finite(what, *numbers):
        if abs(each) > _FARTHEST:
            raise ValueError(f"{each:g} is no {what}: at most {_FARTHEST:g} mm or rad, and per second")
    return tuple(map(float, numbers))


def _finite(what: str, *numbers: float) -> tuple[float, ...]:
    for each in numbers:
        if not math.isfinite(each):
            raise ValueError(f"{each} is no {what}")
    return tuple(map(float, numbers))
