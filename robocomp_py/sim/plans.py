"""Plans: what robots would be told, tried in copies of a world before one of them is followed.

    left = [Command(0.0, "base", (300.0, 0.0, -0.5)), Command(1.0, "base", (300.0, 0.0, 0.5))]
    right = [Command(0.0, "base", (300.0, 0.0, 0.5)), Command(1.0, "base", (300.0, 0.0, -0.5))]
    outcomes = evaluate(world, [left, right], 2.0, watched=[("base", "table")])
    best = max(outcomes, key=lambda each: each.distances[0])

A plan is a list of commands, or a policy: a function that is called each 50 ms with the copy, which it may look at and
tell what to do. A world that follows a plan ends as its outcome says, bit by bit.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from ..innermodel.axes import Array
from ..innermodel.read import InnerModelError
from ..spelling import unknown
from .motion import SimulationError
from .state import FARTHEST
from .world import World

PERIOD = 0.05
"""How often policies are called, and poses and distances are noted, s."""

MOST_TIME = 3600.0
"""The longest plan, s."""


class Command(NamedTuple):
    """What a robot is told at a time."""

    at: float
    """s since the beginning of the plan."""
    node: str
    """A base, a joint or a gripper."""
    values: tuple[float, ...]
    """Of a base: ahead and aside in mm/s, and turn in rad/s; it holds as `World.drive` says. Of a joint: its position
    in rad or mm, and its speed per second, or 0: at once. Of a gripper: 1 to grip, 0 to release."""


Policy = Callable[[World], None]
Plan = Sequence[Command] | Policy


class Touching(NamedTuple):
    """Two shapes that touched."""

    one: str
    other: str
    time: float
    """When they first did, s since the beginning of the plan."""


class Outcome(NamedTuple):
    """What a plan leads to."""

    times: Array
    """When poses were noted, s since the beginning of the plan, shape (n,); the last one is at its end."""
    poses: dict[str, Array]
    """By id, of all that can move: seen from the root, shape (n, 4, 4), mm."""
    contacts: tuple[Touching, ...]
    """All pairs of shapes that touched while physics was on, in the order of their first contact. Bodies that slept
    all the time are left out."""
    distances: tuple[float, ...]
    """Of each watched pair of nodes: the least distance of their shapes that was noted, mm; 0 or less: they overlap."""
    digest: str
    """`World.digest` at the end."""
    failed: str
    """Why physics had no result, and the plan ended early; "" if it did not."""


def evaluate(
    world: World, plans: Sequence[Plan], horizon: float, *, watched: Sequence[tuple[str, str]] = ()
) -> list[Outcome]:
    """Try plans for a time in s, each in a copy of the world, which does not change; in their order.

    Copies run in threads, at most one for each processor, so policies must not share what they change. Raises
    InnerModelError for names that the scene does not have and ValueError for wrong numbers, both before anything runs,
    and what a policy raises.
    """
    for plan in plans:
        _check(world, plan, horizon, watched)
    if not plans:
        return []
    with ThreadPoolExecutor(min(len(plans), os.cpu_count() or 1), "plan") as threads:
        return list(threads.map(lambda plan: _followed(world.copy(), plan, horizon, watched), plans))


def follow(world: World, plan: Plan, horizon: float, *, watched: Sequence[tuple[str, str]] = ()) -> Outcome:
    """Follow a plan in the world itself. Raises what `evaluate` raises."""
    _check(world, plan, horizon, watched)
    return _followed(world, plan, horizon, watched)


def _followed(world: World, plan: Plan, horizon: float, watched: Sequence[tuple[str, str]]) -> Outcome:
    period, ticks = max(1, round(PERIOD / world.tick)), round(horizon / world.tick)
    waiting = [] if callable(plan) else sorted(plan, key=lambda each: each.at)[::-1]
    touched: dict[tuple[str, str], float] = {}
    times: list[float] = []
    poses: list[Array] = []
    least = [math.inf] * len(watched)
    failed = ""
    for tick in range(ticks + 1):
        if tick % period == 0 or tick == ticks:
            times.append(tick * world.tick)
            poses.append(world.poses())
            least = [min(so_far, world.distance(*pair)) for so_far, pair in zip(least, watched, strict=True)]
        if tick == ticks:
            break
        if callable(plan) and tick % period == 0:
            plan(world)
        while waiting and waiting[-1].at <= tick * world.tick:
            _tell(world, waiting.pop())
        try:
            world.step()
        except SimulationError as exc:
            failed = str(exc)
            break
        for pair in world.touching():
            touched.setdefault(pair, (tick + 1) * world.tick)
    return Outcome(
        np.array(times),
        dict(zip(world.movable, np.array(poses).swapaxes(0, 1), strict=True)),
        tuple(Touching(*pair, time) for pair, time in touched.items()),
        tuple(least),
        world.digest(),
        failed,
    )


def _tell(world: World, command: Command) -> None:
    if command.node in world.bases:
        world.drive(command.node, *command.values)
    elif command.node in world.joints:
        world.move_joint(command.node, *command.values)
    elif command.values[0]:
        world.grip(command.node)
    else:
        world.release(command.node)


def _check(world: World, plan: Plan, horizon: float, watched: Sequence[tuple[str, str]]) -> None:
    if not 0.0 < horizon <= MOST_TIME:
        raise ValueError(f"a plan of {horizon} s: it has to be more than 0 and at most {MOST_TIME:g}")
    for pair in watched:
        world.distance(*pair)
    told = ((3, world.bases), (2, world.joints), (1, world.grippers))
    for command in () if callable(plan) else plan:
        most = next((count for count, nodes in told if command.node in nodes), 0)
        if not most:
            raise InnerModelError(
                unknown("base, joint or gripper", command.node, [each for _, nodes in told for each in nodes])
            )
        if not 1 <= len(command.values) <= most or not all(map(math.isfinite, (command.at, *command.values))):
            raise ValueError(f"{command}: it needs a time, and 1 to {most} values that are finite numbers")
        if max(map(abs, command.values)) > FARTHEST:
            raise ValueError(f"{command}: a value is at most {FARTHEST:g}")
        if command.at < 0.0:
            raise ValueError(f"{command}: its time is before the beginning")
