"""What a simulated scene is made of, and its state, which can be kept and copied."""

from __future__ import annotations

import copy
import hashlib
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, Self, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..innermodel import axes
from ..innermodel.axes import Array
from ..innermodel.pictures import Pixels
from ..innermodel.read import InnerModelError, number_of
from ..innermodel.tree import Tree
from ..spelling import unknown
from .bases import Drive, Speed, Three
from .build import Base, Scene, build, rebuilt
from .devices.imu import Inertia
from .devices.laser import Laser
from .devices.lidar import Lidar, is_lidar
from .devices.touch import Touch
from .edits import fingerprint
from .joints import Motor
from .looks import CAMERAS, cameras, lens_of
from .parameters import Parameters
from .speeds import update_speeds

TICK = 0.005
"""Length of a tick, s."""

HOLD = 1.0
"""How long a base goes on at a speed that it was told, s."""

FARTHEST = 1e9
"""mm or rad, also a second: a base does not go on beyond this, 1000 km."""

_DEVICES = {"laser", "display", "imu", "touchsensor", *CAMERAS}

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Saved:
    """The state of a world at a moment; see `State.save`."""

    world: State


class Room(NamedTuple):
    """The distance of a base from the obstacles that stop it."""

    left: float
    """No shape of the base is nearer to an obstacle, m."""
    reach: float
    """From its origin to the farthest point of its shapes, m."""


class State:
    """A scene at some moment. One thread uses it at a time."""

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
        wrong parameters, and TypeError if `tree` is not a Tree.
        """
        check_tree(tree)
        if not 0.0 < tick < math.inf or not 0.0 <= hold < math.inf:
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

    def _equip(self, parameters: Parameters, before: Scene | None = None, *, is_final: bool = False) -> None:
        """Make the model of the tree, from the scene before it if that is enough, and the devices in it.

        For `is_final`, see `rebuilt`.
        """
        tree = self._tree
        made = rebuilt(before, tree, parameters, is_final=is_final) if before else None
        self._scene: Scene = made or build(tree, self._tick, without_meshes=self._without_meshes, parameters=parameters)
        if not before or self._has_other_devices(before.tree):
            self._find_devices(parameters, before)
        self._stopping: dict[str, list[tuple[int, NDArray[np.intp], Array]]] = {}
        self._deep: dict[str, tuple[bytes, dict[tuple[int, int], float]]] = {}
        """By base: the vector of positions when `_depths` were computed last, and what they were."""
        self._carriers: frozenset[str] | None = None
        """The joints that move shapes that stop bases or are stopped; None: not yet known."""
        self._rooms: tuple[bytes, dict[str, Room]] = b"", {}
        """A vector of positions, and by base how far it may move from there before it has to check obstacles.

        Copies share it, so a new one is made for each change.
        """
        self._touches = {name: Touch(tree, name, self._scene) for name in self._touching}
        if self._scene.grippers or any(touch.needs_waking for touch in self._touches.values()):
            self._scene.model.tree_sleep_policy[:] = mujoco.mjtSleepPolicy.mjSLEEP_NEVER

    def _has_other_devices(self, before: Tree) -> bool:
        """Whether a device, or what moves, may not be what it was in the tree before."""
        tree, changed = self._tree, self._scene.changed
        if changed is None:
            return True
        return any((tree if name in tree else before).node(name).tag in _DEVICES for name in changed)

    def _find_devices(self, parameters: Parameters, before: Scene | None) -> None:
        """Make the devices of the tree, and note what moves. Lasers that are what they were in `before` are kept."""
        tree, tags, lasers = self._tree, self._tree.tags, self._lasers
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
        frames = [self._scene.frames[name] for name in self._movable]
        self._frames = (
            np.array([frame.body for frame in frames], dtype=np.intp),
            np.array([frame.rotation for frame in frames]),
            np.array([frame.position for frame in frames]),
        )
        """Of those: the body, and the pose within it."""
        self._free = np.flatnonzero(self._scene.model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE))
        self._lenses = {name: lens_of(tree.node(name)) for name in cameras(tree)}
        self._displays = dict.fromkeys(name for name, tag in tags.items() if tag == "display")
        self._imus = {name: self._scene.frames[name] for name, tag in tags.items() if tag == "imu"}
        self._touching = [name for name, tag in tags.items() if tag == "touchsensor"]

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
            noise = number_of(self._tree.node(name).values.get("noise", 0.0))
            found |= {name: noise} if noise else {}
        return found

    def copy(self) -> Self:
        """A world with the same state, which goes on by itself."""
        made = object.__new__(type(self))
        made.__dict__.update(self.__dict__)
        self._scene.made_by.draft.is_shared = True
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

    def _take(self, other: State) -> None:
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
        return round(self._ticks * self._tick, 9)  # 12.12, and not 12.120000000000001

    @property
    def physics(self) -> bool:
        """Whether bodies have weight and shapes are solid."""
        return self._physics

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

    def position(self, joint: str) -> float:
        """Of a joint: rad, or mm if it slides."""
        found = existing("joint", joint, self._scene.joints)
        place = float(self._data.qpos[found.place])
        return (place - found.offset) * 1000.0 if found.slides else place

    def _pose(self, base: Base) -> Three:
        places = self._places
        return places[base.x] * 1000.0, places[base.z] * 1000.0, places[base.turn]

    def _resting(self, base: str) -> Drive:
        """Of a base that is told nothing, and believes to be where it is."""
        pose = self._pose(self._scene.bases[base])
        return Drive(Speed(), None, pose, pose)

    def _place(self, base: Base, pose: Three) -> None:
        places = self._places
        x, z, turn = pose
        places[base.x], places[base.z], places[base.turn] = x / 1000.0, z / 1000.0, turn

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

    def _matrix(self, name: str) -> Array:
        frame = existing("node", name, self._scene.frames)
        turn = self._data.xmat[frame.body].reshape(3, 3)
        position = axes.position_from_simulation(self._data.xpos[frame.body] + turn @ frame.position)
        return axes.pose(position.tolist(), axes.rotation_from_simulation(turn @ frame.rotation))

    def _drive(self, base: str) -> Drive:
        existing("base", base, self._scene.bases)
        return self._drives[base]


def check_tree(given: object) -> None:
    """Raise TypeError for anything else, such as the name of a file."""
    if not isinstance(given, Tree):
        raise TypeError(
            f"{given!r} is not a Tree; `Tree.read`, of robocomp_py.innermodel.tree, reads a scene from a file"
        )


def existing(kind: str, name: str, among: Mapping[str, T]) -> T:
    """What has this name. Raises InnerModelError for an unknown name."""
    try:
        return among[name]
    except KeyError:
        raise InnerModelError(unknown(kind, name, among)) from None
