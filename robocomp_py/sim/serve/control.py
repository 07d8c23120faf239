"""Simulation and SimulationPub: a scene is controlled, and tells how it goes on."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from ...contract.component import Port
from ...contract.types import Sequence, Struct
from ...errors import RobocompError
from ...innermodel import axes
from ...innermodel.axes import Array
from ...innermodel.read import InnerModelError
from ...runtime.clock import Real
from ...runtime.worker import Worker
from ...spelling import unknown
from .pace import Pace
from .values import declared, filled, operation

if TYPE_CHECKING:
    from ...innermodel.tree import Tree
    from ..editing import Editing
    from ..plans import Outcome
    from ..state import Saved
    from ..world import World

log = logging.getLogger("robocomp.sim")

_MOST_TICKS = 20_000
"""Of one call of `step`."""

_MOST_SAVED = 16
"""States that are kept."""

_MOST_PLANS, _MOST_PLANNED = 64, 600.0
"""Of one call of `evaluate`: plans, and the sum of their times in s."""

_BUSY = 0.8
"""The part of a period for which a scene goes on at most, if it follows the machine. Handlers run in the rest."""

_SUCTION = "; `suction`, in an item of the parameter `bodies`, makes a node one"

_CHUNK = 20
"""Ticks between two looks at the machine's clock."""

_CHUNK_OF_PHYSICS = 5
"""The same while physics is on, since they take longer then."""


class Controlled(Worker[Any]):
    """The handlers of Simulation, for a component that implements it. They act on `self.world`."""

    world: World
    _editing: Editing
    _pace: Pace
    _token = 0
    _saved: dict[int, Saved]
    """Saved states by their tokens, oldest first."""
    _told_tree: Tree | None = None
    _text = ""
    """`_told_tree` as a file."""

    def follow(self) -> None:
        """Go on to the present time, at the speed that was set."""
        self.settle()
        try:
            self._go_on()
        except RobocompError as exc:
            self._pace.is_paused = True
            log.error("%s; the scene stands still until it is reset", exc)

    def settle(self) -> None:
        """Called before the scene goes on: edits take effect now."""

    def _go_on(self) -> None:
        pace, world = self._pace, self.world
        due = pace.follow(self.now(), world.ticks)
        if not isinstance(self._clock, Real):
            world.step(due)
            return
        is_fast = pace.speed == 0.0 and not pace.is_paused
        end, chunk = time.monotonic() + _BUSY * self.period, _CHUNK_OF_PHYSICS if world.physics else _CHUNK
        while (due or is_fast) and time.monotonic() < end:
            count = chunk if is_fast else min(due, chunk)
            world.step(count)
            due -= 0 if is_fast else count
        pace.owe(due)

    def Simulation_now(self) -> Any:
        """How far the scene is."""
        return filled(self._result("now"), moment(self.world, self._pace))

    def Simulation_step(self, count: int) -> Any:
        """Go on by some ticks at once."""
        if not 0 <= count <= _MOST_TICKS:
            raise self._refusal("step", f"{count} ticks in one call: it is from 0 to {_MOST_TICKS}")
        self.settle()
        try:
            self.world.step(count)
        except RobocompError as exc:
            raise self._refusal("step", str(exc)) from exc
        return filled(self._result("step"), moment(self.world, self._pace))

    def Simulation_pause(self) -> None:
        """Stand still."""
        self._pace.is_paused = True

    def Simulation_resume(self) -> None:
        """Go on after a pause."""
        self._pace.is_paused = False

    def Simulation_setSpeed(self, factor: float) -> None:
        """Go on at a factor of the component's clock; 0: as fast as possible."""
        if factor == 0.0 and not isinstance(self._clock, Real):
            raise self._refusal(
                "setSpeed",
                "the scene follows the clock of its network, which is as fast as possible by itself; "
                "0 needs the machine's clock",
            )
        try:
            self._pace.set_speed(factor, self.now(), self.world.ticks)
        except ValueError as exc:
            raise self._refusal("setSpeed", str(exc)) from exc

    def Simulation_reset(self, seed: int) -> None:
        """Begin again without edits, with noise of another seed."""
        if seed < 0:
            raise self._refusal("reset", f"a seed of {seed}: it is 0 or more")
        try:
            self._editing.reset(seed)
        except InnerModelError as exc:
            raise self._refusal("reset", str(exc)) from exc
        self.settle()

    def Simulation_setPhysics(self, on: bool) -> None:
        """Switch physics on or off."""
        self.world.set_physics(on)

    def Simulation_setNoise(self, id: str, sigma: float) -> None:
        """Set the standard deviation of what disturbs a node."""
        try:
            self.world.set_noise(id, sigma)
        except (InnerModelError, ValueError) as exc:
            raise self._refusal("setNoise", str(exc)) from exc

    def Simulation_scene(self) -> str:
        """The scene as a file."""
        self.settle()
        if self._told_tree is not self.world.tree:
            self._told_tree = self.world.tree
            self._text = self._told_tree.text().decode()
        return self._text

    def Simulation_cloud(self, id: str, known: int) -> Any:
        """The points of a cloud, unless the caller knows them."""
        if id not in self.world.tree or self.world.tree.node(id).tag != "pointcloud":
            clouds = [name for name, tag in self.world.tree.tags.items() if tag == "pointcloud"]
            raise self._refusal("cloud", unknown("pointcloud", id, clouds))
        kind, found = self._result("cloud"), self._editing.clouds.get(id)
        if found is None or found.version == known:
            return filled(kind, {"version": found.version if found else 0})
        points, colours = found.points.astype(np.float32).ravel(), found.colours.astype(np.uint8).ravel()
        return filled(kind, {"version": found.version, "points": points, "colours": colours})

    def Simulation_poses(self, ids: list[str]) -> Any:
        """Where nodes truly are; all that can move if none is named."""
        kind = self._result("poses")
        assert isinstance(kind, Sequence)
        try:
            matrices = {name: self.world.matrix(name) for name in ids or self.world.movable}
        except InnerModelError as exc:
            raise self._refusal("poses", str(exc)) from exc
        return [filled(kind.item, pose(name, matrix)) for name, matrix in matrices.items()]

    def Simulation_contacts(self) -> Any:
        """What touches while physics is on."""
        kind = self._result("contacts")
        assert isinstance(kind, Sequence)
        found, time = self.world.contacts(), self.world.time
        values = [{"one": each.one, "other": each.other, "force": each.force, "time": time} for each in found]
        return [filled(kind.item, each) for each in values]

    def Simulation_attach(self, gripper: str) -> str:
        """Switch a suction cup or magnet on; returns the body that it holds, or ""."""
        try:
            return self.world.grip(gripper)
        except InnerModelError as exc:
            raise self._refusal("attach", f"{exc}{_SUCTION}") from exc

    def Simulation_detach(self, gripper: str) -> None:
        """Switch a suction cup or magnet off."""
        try:
            self.world.release(gripper)
        except InnerModelError as exc:
            raise self._refusal("detach", f"{exc}{_SUCTION}") from exc

    def Simulation_save(self) -> int:
        """Keep the state of now; returns a token for it."""
        self.settle()
        token = self._token = self._token + 1
        self._saved[token] = self.world.save()
        while len(self._saved) > _MOST_SAVED:
            del self._saved[next(iter(self._saved))]
        return token

    def Simulation_restore(self, token: int) -> None:
        """Go on from a kept state."""
        self.settle()
        if token not in self._saved:
            raise self._refusal("restore", f"there is no saved state {token}: the last {_MOST_SAVED} are kept")
        try:
            self.world.restore(self._saved[token])
        except ValueError as exc:
            text = f"{exc}: edits that add, remove or move nodes make states of before unusable"
            raise self._refusal("restore", text) from exc

    def Simulation_evaluate(self, plans: Any, horizon: float, watched: Any) -> Any:
        """Try plans in copies of the scene."""
        from ..plans import Command, evaluate  # few simulations need it

        if len(plans) > _MOST_PLANS or len(plans) * horizon > _MOST_PLANNED:
            text = f"{len(plans)} plans of {horizon:g} s: at most {_MOST_PLANS}, and {_MOST_PLANNED:g} s together"
            raise self._refusal("evaluate", text)
        self.settle()
        told = [[Command(each.at, each.node, tuple(map(float, each.values))) for each in plan] for plan in plans]
        try:
            found = evaluate(self.world, told, horizon, watched=[(pair.one, pair.other) for pair in watched])
        except (InnerModelError, ValueError) as exc:
            raise self._refusal("evaluate", str(exc)) from exc
        return [self._outcome(each) for each in found]

    def _outcome(self, outcome: Outcome) -> Any:
        kind = self._result("evaluate")
        assert isinstance(kind, Sequence)
        assert isinstance(kind.item, Struct)
        items = {each.name: each.type.item for each in kind.item.fields if isinstance(each.type, Sequence)}
        touched = [{"one": each.one, "other": each.other, "time": each.time} for each in outcome.contacts]
        values = {
            "poses": [filled(items["poses"], pose(name, each[-1])) for name, each in outcome.poses.items()],
            "contacts": [filled(items["contacts"], each) for each in touched],
            "distances": np.array(outcome.distances),
            "failed": outcome.failed,
        }
        return filled(kind.item, values)

    def _result(self, name: str) -> Any:
        return operation(self._simulation().interface, name).outputs[0].type

    def _refusal(self, name: str, text: str) -> Exception:
        return declared(self._simulation().interface, name, "SimulationException", text)

    def _simulation(self) -> Port:
        return next(port for port in self.component.ports if port.interface.short == "Simulation")


class Progress:
    """What is published of a scene: how far it is, and what has moved since the message before."""

    def __init__(self, world: World, pace: Pace, port: Port) -> None:
        self._world, self._pace = world, pace
        at, moved = (each.type for each in operation(port.interface, "advanced").inputs)
        assert isinstance(moved, Sequence)
        self._at, self._pose = at, moved.item
        self._told: dict[str, bytes] = {}

    def take(self) -> tuple[Any, list[Any]]:
        """The arguments of the next message."""
        movable, matrices = self._world.movable, self._world.poses()
        told = dict(zip(movable, map(np.ndarray.tobytes, matrices), strict=True))
        moved = (
            (name, matrix) for name, matrix in zip(movable, matrices, strict=True) if self._told.get(name) != told[name]
        )
        poses = [filled(self._pose, pose(name, matrix)) for name, matrix in moved]
        self._told = told
        return filled(self._at, moment(self._world, self._pace)), poses


def moment(world: World, pace: Pace) -> dict[str, Any]:
    """The fields of a Moment."""
    return {
        "tick": world.ticks,
        "time": world.time,
        "paused": pace.is_paused,
        "physics": world.physics,
        "speed": pace.speed,
        "reached": pace.reached,
    }


def pose(name: str, matrix: Array) -> dict[str, Any]:
    """The fields of a NodePose: mm and rad."""
    numbers = (*matrix[:3, 3].tolist(), *axes.angles(matrix[:3, :3]).tolist())
    return {"id": name, **dict(zip(("x", "y", "z", "rx", "ry", "rz"), numbers, strict=True))}
