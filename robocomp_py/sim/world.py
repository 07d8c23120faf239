"""A simulated scene: it goes on in ticks, and is the same every time.

With physics off, bases and joints move as they are told, and all else stays where it is. With physics on, bodies have
weight, shapes are solid, and motors have to move them.

Lengths are in mm, angles in rad, times in s; axes are those of InnerModel: x to the right, y up, z ahead, and turns to
the right. The state is all in a `World`, so its copy is a world of its own, which goes on in the same way.

`state` has what a world consists of, `motion` how it goes on, and `touching` which shapes touch. Here is what it is
told, and what it tells.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from ..errors import RobocompError
from ..innermodel import axes
from ..innermodel.axes import Array
from ..innermodel.camera import Lens
from ..innermodel.pictures import MOST_SHOWN, Pixels
from ..innermodel.read import ROOT_ID, number_of
from ..innermodel.tree import Tree
from .bases import Pose, Speed
from .devices.imu import Inertia, Inertial
from .devices.imu import read as read_imu
from .edits import carry
from .falling import let_go
from .grippers import hold, nearest
from .joints import At, Motor, To
from .motion import TOUCH, Motion
from .names import PREFIX, of_part
from .noise import normal
from .render import View
from .speeds import Truth, truth
from .state import FARTHEST, check_tree, existing
from .touching import Touching

_STILL, _STILL_MM = 0.001, 0.1
"""rad/s and mm/s: with physics on, what is slower stands still."""


class Overlap(RobocompError):
    """A base that stops before shapes would be inside of one."""


class World(Motion, Touching):
    """A scene that goes on as it is told. One thread uses it at a time."""

    def change(self, tree: Tree, placed: Mapping[str, Array] | None = None) -> None:
        """Go on with another tree, which is not to be changed afterwards: start from a copy of `tree`.

        Everything that both trees have keeps its place and its state, and new nodes begin as the tree has them. Bases
        and free bodies are moved to where `placed` has them, as poses within their parents, shape (4, 4), mm. Raises
        InnerModelError for what cannot be used, and Overlap if a base that stops would be inside of what stops it;
        then nothing has changed.
        """
        self._exchange(tree, placed or {}, may_overlap=False)

    def reset(self, seed: int | None = None, tree: Tree | None = None) -> None:
        """Begin again at tick 0, with all as the tree had it; with another seed if one is given.

        Physics stays on or off, and what `change` has edited stays so; with a tree of before, such as the first `tree`,
        the world begins again with that one. Raises InnerModelError for a tree that cannot be used.
        """
        if tree is not None and tree is not self._tree:
            self._exchange(tree, {}, may_overlap=True)
        super().reset(seed)

    def _exchange(self, tree: Tree, placed: Mapping[str, Array], *, may_overlap: bool) -> None:
        check_tree(tree)
        before = object.__new__(World)  # with the same data: the edited world gets others
        before.__dict__.update(self.__dict__)
        parameters = {name: values for name, values in self._parameters.items() if name in tree}
        try:
            self._tree = tree
            self._equip(parameters, before._scene, is_final=not placed)
            self._use(mujoco.MjData(self._scene.model))
            self._data.qpos[:] = self._scene.start
            carry(before._scene, before._data, self._scene, self._data)
            self._told = {}
            self._update()
            for name, pose in placed.items():
                self._set_pose(name, pose)
            self._keep(before)
            if not may_overlap and (placed or self._has_other_stops()):
                self._check_overlaps(before)
        except BaseException:
            self.__dict__ = before.__dict__
            raise
        self._original, self._edits = before._original or before._tree, None

    def _has_other_stops(self) -> bool:
        """Whether there may be other shapes that stop bases, or other bases, than before the last change."""
        tree, changed = self._tree, self._scene.changed
        return changed is None or any(tree.node(name).values.get("collide") for name in changed if name in tree)

    def _check_overlaps(self, before: World) -> None:
        overlaps = before._overlaps()
        for (one, other), depth in self._overlaps().items():
            if depth < overlaps.get((one, other), 0.0) - TOUCH:
                raise Overlap(f"`{one}` would be {-depth * 1000:.1f} mm deep in `{other}`")

    def _keep(self, before: World) -> None:
        """Take over what was told before, as far as it is about nodes that are still there."""
        noise = self._usual_noise()
        for name in {**self._scene.bases, **self._lasers, **self._imus, **self._lenses}:
            if name in before._tree and (name in before._noise or name in noise):
                noise[name] = before._noise.get(name, 0.0)
        self._noise = noise
        self._shown = {name: pixels for name, pixels in before._shown.items() if name in self._displays}
        self._inertias = {name: before._inertias.get(name, Inertia()) for name in self._imus}
        grippers, self._held = self._scene.grippers, {}
        for name, body in before._held.items():
            if name in grippers and body in grippers[name].welds:
                self._attach(name, body)
        self._set_drives({name: before._drives.get(name) or self._resting(name) for name in self._scene.bases})
        joints, old = self._scene.joints, before._scene.joints
        kept = {name for name, joint in joints.items() if name in old and old[name].slides == joint.slides}
        self._set_motors(
            {name: before._motors[name] if name in kept else Motor(self.position(name)) for name in joints}
        )

    def _set_pose(self, name: str, pose: Array) -> None:
        """Put a base, or a free body, where a pose within its parent says, at rest."""
        node, model = self._tree.node(name), self._scene.model
        if name in self._scene.bases:
            tilt, roll = (number_of(node.values[each]) for each in ("rx", "rz"))
            turned = axes.rotation(tilt, 0.0, 0.0).T @ pose[:3, :3] @ axes.rotation(0.0, 0.0, roll).T
            self._place(
                self._scene.bases[name],
                Pose(float(pose[0, 3]), float(pose[2, 3]), math.atan2(turned[0, 2], turned[0, 0])),
            )
            parts = [model.joint(of_part(PREFIX + name, each)).id for each in ("x", "z", "turn")]
            self._data.qvel[model.jnt_dofadr[parts]] = 0.0
        else:
            joint = model.joint(PREFIX + name)
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

    def set_physics(self, on: bool) -> None:
        """Switch physics on or off. All is where it was, and at rest; joints that move go on, and grippers let go."""
        if on == self._physics:
            return
        for gripper in list(self._held):
            self.release(gripper)
        self._physics = on
        self._data.qvel[:] = 0.0
        for drive in self._drives.values():
            drive.wheels = drive.speed
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

    # What robots are told.

    def drive(self, base: str, ahead: float = 0.0, aside: float = 0.0, turn: float = 0.0) -> None:
        """Drive at mm/s and rad/s. A base with two wheels does not move aside.

        Raises InnerModelError if there is no such base, and ValueError for speeds that no robot has.
        """
        found = existing("base", base, self._scene.bases)
        speed = Speed(*_near("speed", ahead, aside if found.is_omni else 0.0, turn))
        drive = self._drives[base]
        drive.speed, drive.expires = speed, self._ticks + self._hold if self._hold else None
        drive.wheels = speed

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
        known = {name: existing("joint", name, self._scene.joints) for name in goals}
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
            existing("joint", name, self._scene.joints)
        checked = {name: _near("speed", *goal) for name, goal in goals.items()}
        for name, (speed, acceleration) in checked.items():
            self._set_motor(name, self._motors[name]._replace(goal=At(speed, abs(acceleration))))

    def grip(self, gripper: str) -> str:
        """Switch a suction cup or magnet on: it holds the nearest body that it reaches, where it is.

        Returns the id of the body that it holds; "" if it reaches none, or physics is off. One that holds a body keeps
        it. Raises InnerModelError if there is no such gripper.
        """
        found = existing("gripper", gripper, self._scene.grippers)
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
        found = existing("gripper", gripper, self._scene.grippers)
        if gripper in self._held:
            self._data.eq_active[found.welds[self._held.pop(gripper)]] = 0

    def held(self, gripper: str) -> str:
        """The id of the body that a gripper holds; "" if it holds none."""
        existing("gripper", gripper, self._scene.grippers)
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
        existing("imu", imu, self._imus)
        yaw = self._inertias[imu].yaw + self.inertial(imu).yaw
        self._inertias[imu] = self._inertias[imu]._replace(yaw=yaw)

    def set_noise(self, node: str, deviation: float) -> None:
        """Set the standard deviation of what disturbs a node.

        Of a laser, mm; of an inertial unit, m/s² and rad/s; of a base, a part of its speed; of a camera, a part of
        its depths.
        """
        disturbed = {**self._scene.bases, **self._lasers, **self._imus, **self._lenses}
        existing("laser, imu, base or camera", node, disturbed)
        (deviation,) = _finite("standard deviation", deviation)
        if deviation < 0.0:
            raise ValueError(f"a standard deviation of {deviation}")
        self._noise[node] = deviation

    def show(self, display: str, pixels: Pixels | None) -> None:
        """Let a display show a picture: red, green and blue, rows from the top, shape (height, width, 3); None: its
        colour. It is seen from now on, by every camera.

        Raises InnerModelError if there is no such display, and ValueError for what is no picture.
        """
        existing("display", display, self._displays)
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
        return Pose(*self._drive(base).odometry)

    def corrected(self, base: str) -> Pose:
        """The last pose that the base was told, moved on by its wheels."""
        return Pose(*self._drive(base).corrected)

    def speed(self, base: str) -> Speed:
        """The speed of a base by its wheels, in mm/s and rad/s, without its noise: 0 if it is blocked.

        With physics on, less than 0.1 mm/s and 0.001 rad/s count as 0.
        """
        ahead, aside, turn = self._drive(base).wheels
        if self._physics:
            ahead, aside = (each if abs(each) > _STILL_MM else 0.0 for each in (ahead, aside))
            turn = turn if abs(turn) > _STILL else 0.0
        return Speed(ahead, aside, turn)

    def joint_speed(self, joint: str) -> float:
        """Of a joint: rad/s, or mm/s if it slides."""
        found = existing("joint", joint, self._scene.joints)
        if not self._physics:
            return self._motors[joint].speed
        speed = float(self._data.qvel[found.freedom])
        return speed * 1000.0 if found.slides else speed

    def is_moving(self, joint: str) -> bool:
        """Whether a joint has not reached its goal, or has a speed.

        With physics on, a speed comes near to 0, but hardly ever becomes 0: 0.001 rad/s and 0.1 mm/s count as 0.
        """
        speed, found = abs(self.joint_speed(joint)), self._scene.joints[joint]
        least = (_STILL_MM if found.slides else _STILL) if self._physics else 0.0
        return self._motors[joint].goal is not None or speed > least

    def matrix(self, node: str, seen_from: str = ROOT_ID) -> Array:
        """The true pose of a node, shape (4, 4): from `node` to `seen_from`, lengths in mm."""
        found = self._matrix(node)
        if seen_from == ROOT_ID:
            return found
        made: Array = axes.inverse(self._matrix(seen_from)) @ found
        return made

    def poses(self) -> Array:
        """The poses of all `movable` nodes, seen from the root: shape (n, 4, 4), mm."""
        bodies, rotations, positions = self._frames
        made = np.zeros((len(bodies), 4, 4))
        if not len(bodies):
            return made
        turns = self._data.xmat[bodies].reshape(-1, 3, 3)
        away = turns @ positions[:, :, None]
        made[:, :3, :3] = axes.rotation_from_simulation(turns @ rotations)
        made[:, :3, 3] = axes.position_from_simulation(self._data.xpos[bodies] + away[..., 0])
        made[:, 3, 3] = 1.0
        return made

    def scan(self, laser: str) -> Array:
        """The distances that a laser measures now, mm, shape (measures,), from the right to the left."""
        found = existing("laser", laser, self._lasers)
        deviation = self._noise.get(laser, 0.0)
        noise = None
        if deviation:
            noise = deviation * normal(self._seed, laser, "distance", self._ticks, len(found.angles))
        return found.scan(self._scene.model, self._data, noise)

    def angles(self, laser: str) -> Array:
        """Of a laser's rays, rad to the right, shape (measures,)."""
        return existing("laser", laser, self._lasers).angles

    def cloud(self, lidar: str) -> Array:
        """The points that a lidar measures now, within its node: mm, shape (n, 3).

        They are sorted by their direction, from the left to the right. Noise is along the rays.
        """
        found = existing("lidar", lidar, self._lidars)
        deviation = self._noise.get(lidar, 0.0)
        noise = deviation * normal(self._seed, lidar, "cloud", self._ticks, found.count) if deviation else None
        return found.cloud(self._scene.model, self._data, noise)

    def lens(self, camera: str) -> Lens:
        """The size of a camera's pictures, and its focal length; pixels."""
        return existing("camera", camera, self._lenses)

    def view(self) -> View:
        """All that cameras see of the world as it is now. `Renderer.picture` draws it, in any thread."""
        noise = {name: self._noise[name] for name in self._lenses if name in self._noise}
        return View(self._scene, self._data.qpos.copy(), self._seed, self._ticks, noise, dict(self._shown))

    def inertial(self, imu: str) -> Inertial:
        """What an inertial unit measures now. Its yaw is 0 where `reset_imu` was called, and ahead before."""
        found = existing("imu", imu, self._imus)
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
        found = existing("sensor of touch", sensor, self._touches)
        return (found.read if self._physics else found.overlaps)(self._scene.model, self._data)

    def truth(self, node: str) -> Truth:
        """Where any node is and how it moves, in m and rad, seen from the root."""
        found = existing("node", node, self._scene.frames)
        self._update_speeds()
        return truth(self._scene.model, self._data, found)


def _near(what: str, *numbers: float) -> tuple[float, ...]:
    """Numbers that messages can carry, too: some interfaces have whole numbers of mm, and floats of 32 bits."""
    for each in _finite(what, *numbers):
        if abs(each) > FARTHEST:
            raise ValueError(f"{each:g} is no {what}: at most {FARTHEST:g} mm or rad, and per second")
    return tuple(map(float, numbers))


def _finite(what: str, *numbers: float) -> tuple[float, ...]:
    for each in numbers:
        if not math.isfinite(each):
            raise ValueError(f"{each} is no {what}")
    return tuple(map(float, numbers))
