"""Measures a simulated scene: ticks, laser scans, plans and edits; environments of Gymnasium; and its component, from
its start to its pictures.

Where MuJoCo alone can do the same, it does so in turn, with the same model and the same state. Times are those of the
processor, except those of the component.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from .components import component
from .goals import Finding
from .query import Tell
from .rounds import Effort, by_turns, ratio, times
from .scenes import hall
from .served import HERTZ, house, served
from .tables import Table, times_as_much, us

RATIO = 1.3
"""Times as long as MuJoCo alone."""

FEW, SHAPES, MANY = 61, 141, 341
TICKS = 40
"""In each call, from the same state."""

CALLS = 5
"""Of each party, in a round."""

STARTS = 3
MOST_DELAY, MOST_SHARE = 0.0004, 20.0
"""Seconds from a filled picture to its handler, and % of a core."""

PLANS, HORIZON = 4, 5.0

ENVIRONMENT_STEP, ENVIRONMENT_RAYS, ENVIRONMENT_STEPS = 0.05, 90, 50
"""Seconds of a step, rays of its laser, and steps in each call."""

MOST_STEPS = 12_600
"""Of an environment in a second. This is the figure of a prototype, of which only the time of a step and the number of
rays are known. `_environments` says what our step does."""

_NETWORK = """\
import "house/house.cdsl";

Deployment hall
{
    Component house
    {
        offers robot0 : OmniRobot, FullPoseEstimation;
        offers robot0_laser : Laser;
    };
};
"""


@dataclass(frozen=True)
class Row:
    what: str
    ours: float
    """µs of one; of plans, of all."""
    goal: str
    """As the table shows it; "" for a row without a goal."""
    met: bool
    bare: float | None = None
    """µs of MuJoCo alone."""
    ratio: float | None = None


def run(effort: Effort, tell: Tell) -> list[Row]:
    tell("simulation · ticks")
    rows = [_ticks(effort, resting=False), _ticks(effort, resting=True)]
    tell("simulation · lasers")
    rows += [_scans(effort, rays) for rays in (360, 1080)]
    tell("simulation · plans and edits")
    rows += [_plans(effort), *_edits(effort)]
    tell("simulation · environments")
    rows += _environments(effort)
    tell("simulation · component")
    return [*rows, _start(), *_served(effort)]


def _compared(what: str, ours: Callable[[], object], bare: Callable[[], object], effort: Effort, parts: int) -> Row:
    """One of `parts` of what a call does."""
    mine, its = by_turns([lambda: _seconds_of(ours), lambda: _seconds_of(bare)], effort.rounds)
    found = ratio(mine, its)
    goal = f"≤ {RATIO:g} ×"
    return Row(what, times(mine).p50 / parts, goal, found <= RATIO, times(its).p50 / parts, found)


def _seconds_of(call: Callable[[], object]) -> list[float]:
    """The processor time of each of `CALLS` calls, after one that warms up."""
    call()
    taken = []
    for _ in range(CALLS):
        begun = time.process_time()
        call()
        taken.append(time.process_time() - begun)
    return taken


def _ticks(effort: Effort, *, resting: bool) -> Row:
    import mujoco

    from robocomp_py.sim.build import build
    from robocomp_py.sim.world import World

    tree = hall(SHAPES, resting=resting)
    world = World(tree, physics=True, hold=0)
    world.drive("robot0", ahead=200.0)
    world.step(TICKS)
    saved = world.save()
    model = build(tree, world.tick).model
    begun, data = mujoco.MjData(model), mujoco.MjData(model)
    begun.qpos[:] = build(tree, world.tick).start
    for _ in range(TICKS):
        mujoco.mj_step(model, begun)

    def ours() -> None:
        world.restore(saved)
        world.step(TICKS)

    def bare() -> None:
        mujoco.mj_copyData(data, model, begun)
        for _ in range(TICKS):
            mujoco.mj_step(model, data)

    return _compared(f"tick, 20 boxes {'at rest' if resting else 'that fall'}", ours, bare, effort, TICKS)


def _scans(effort: Effort, rays: int) -> Row:
    import mujoco
    import numpy as np

    from robocomp_py.sim.build import build
    from robocomp_py.sim.world import World

    tree = hall(SHAPES)
    tree.set_value("robot0_laser", "measures", rays)
    world, scene = World(tree), build(tree, 0.005)
    data = mujoco.MjData(scene.model)
    data.qpos[:] = scene.start
    mujoco.mj_kinematics(scene.model, data)
    turns = np.linspace(-np.pi, np.pi, rays, endpoint=False)
    directions = np.stack((np.cos(turns), np.sin(turns), np.zeros(rays)), axis=1)
    frame, hit, reached = scene.frames["robot0_laser"], np.empty(rays, np.int32), np.empty(rays)
    origin = data.xpos[frame.body] + frame.position

    def bare() -> None:
        given = (scene.model, data, origin, directions.ravel(), None, True, frame.body, hit, reached, None, rays, 11.0)
        mujoco.mj_multiRay(*given)

    return _compared(f"laser, {rays} rays", lambda: world.scan("robot0_laser"), bare, effort, 1)


def _plans(effort: Effort) -> Row:
    from robocomp_py.sim.plans import Command, evaluate
    from robocomp_py.sim.world import World

    world = World(hall(MANY), physics=True, hold=0)
    plans = [[Command(0.0, "robot0", (200.0, 0.0, 0.1 * number))] for number in range(PLANS)]
    took = []
    for _ in range(max(1, effort.rounds // 4)):
        begun = time.process_time()  # of all threads: what one core would need
        evaluate(world, plans, HORIZON)
        took.append(time.process_time() - begun)
    factor = PLANS * HORIZON / statistics.median(took)
    name = f"{PLANS} plans of {HORIZON:g} s, {MANY} shapes: {factor:.0f} × real time on a core"
    return Row(name, statistics.median(took) * 1e6, "≥ 20 ×", factor >= 20.0)


def _edits(effort: Effort) -> list[Row]:
    """MuJoCo alone makes the model of the scene with a box more or less, and the data of that model."""
    import mujoco

    from robocomp_py.sim.build import build
    from robocomp_py.sim.world import World

    tree = hall(MANY)
    world, spec = World(tree, physics=True), build(tree, 0.005).made_by.spec
    ours: dict[str, list[float]] = {"add": [], "remove": []}
    bare: dict[str, list[float]] = {"add": [], "remove": []}
    for _ in range(effort.rounds):
        for what in ours:
            tree = world.tree.copy()
            if what == "add":
                tree.add("world", "plane", "post", size=(100.0, 900.0, 100.0), py=3000.0)
            else:
                tree.remove("post")
            begun = time.process_time()
            world.change(tree)
            ours[what].append(time.process_time() - begun)
            begun, spec = time.process_time(), spec.copy()
            if what == "add":
                box, size = mujoco.mjtGeom.mjGEOM_BOX, (0.05, 0.05, 0.45)
                spec.worldbody.add_geom(name="bare", type=box, size=size, pos=(0.0, 0.0, 3.0))
            else:
                spec.delete(spec.geom("bare"))
            mujoco.MjData(spec.compile())
            bare[what].append(time.process_time() - begun)
    return [_edited(what, ours[what], bare[what], goal) for what, goal in (("add", 1600.0), ("remove", 2700.0))]


def _edited(what: str, ours: list[float], bare: list[float], goal: float) -> Row:
    mine, its = statistics.median(ours) * 1e6, statistics.median(bare) * 1e6
    found = mine / its
    is_met = mine <= goal and found <= RATIO
    return Row(f"{what} a node, {MANY} shapes", mine, f"≤ {us(goal)}, ≤ {RATIO:g} ×", is_met, its, found)


def _environments(effort: Effort) -> list[Row]:
    """Steps of an environment of Gymnasium, in episodes that begin with a reset. A call of the component drives a base,
    in ticks, with odometry and obstacles. Its laser, and its true pose with its speeds, are observed.

    MuJoCo alone goes on by as many ticks of the same model, and casts as many rays. With physics off, it does not go
    on: it computes where everything is, and casts the rays."""
    with house(FEW, rays=ENVIRONMENT_RAYS) as folder:
        (folder / "hall.ddsl").write_text(_NETWORK, encoding="utf-8")
        return [_environment(folder, effort, physics=physics) for physics in (False, True)]


def _environment(folder: Path, effort: Effort, *, physics: bool) -> Row:
    import mujoco
    import numpy as np

    from robocomp_py.gym import NetworkEnv, Range

    name, place = "robot0/OmniRobot/setSpeedBase", Range(-100.0, 100.0)
    pose = "robot0/FullPoseEstimation/getFullPoseEuler.ret"
    env = NetworkEnv(
        folder / "hall.ddsl",
        actions={name: {"advx": Range(-200.0, 200.0), "advz": Range(-200.0, 200.0), "rot": Range(-1.0, 1.0)}},
        observations={
            "robot0_laser/Laser/getLaserData.ret[*].dist": Range(0.0, 10000.0),
            f"{pose}.x": place,
            f"{pose}.z": place,
        },
        reward=lambda before, action, after: float(after[f"{pose}.z"][0] - before[f"{pose}.z"][0]),
        seconds=ENVIRONMENT_STEP,
        settings=[("house", f"params.physics={str(physics).lower()}")],
    )
    try:
        env.reset(seed=1)
        world = env.simulation["house"].worker.world
        scene, ticks = world.view().scene, round(ENVIRONMENT_STEP / world.tick)
        data, frame = mujoco.MjData(scene.model), scene.frames["robot0_laser"]
        data.qpos[:] = scene.start
        turns = np.linspace(-np.pi, np.pi, ENVIRONMENT_RAYS, endpoint=False)
        directions = np.stack((np.cos(turns), np.sin(turns), np.zeros(ENVIRONMENT_RAYS)), axis=1).ravel()
        hit, reached = np.empty(ENVIRONMENT_RAYS, np.int32), np.empty(ENVIRONMENT_RAYS)
        actions = np.random.default_rng(1).uniform(-1.0, 1.0, (ENVIRONMENT_STEPS, 3)).astype(np.float32)

        def ours() -> None:
            env.reset(seed=1)
            for action in actions:
                env.step(action)

        def bare() -> None:
            mujoco.mj_resetData(scene.model, data)
            data.qpos[:] = scene.start
            for _ in range(ENVIRONMENT_STEPS):
                if physics:
                    for _ in range(ticks):
                        mujoco.mj_step(scene.model, data)
                else:
                    mujoco.mj_kinematics(scene.model, data)
                origin = data.xpos[frame.body] + frame.position
                given = (directions, None, True, frame.body, hit, reached, None, ENVIRONMENT_RAYS, 11.0)
                mujoco.mj_multiRay(scene.model, data, origin, *given)

        seen = f"{ENVIRONMENT_RAYS} rays and a pose with speeds"
        what = f"step of an environment, {FEW} shapes, {seen}, physics {'on' if physics else 'off'}"
        row = _compared(what, ours, bare, effort, ENVIRONMENT_STEPS)
    finally:
        env.close()
    rate = 1.0 / row.ours * 1e6
    told = f"{row.what}: {rate:.0f} in a second"
    if physics:
        return replace(row, what=told, goal="", met=True)
    return Row(told, row.ours, f"≥ {MOST_STEPS} in a second", rate >= MOST_STEPS, row.bare)


def _start() -> Row:
    """From the process of a component that simulates a scene to `ready`, without a renderer."""
    took = []
    with house(SHAPES) as folder:
        for _ in range(STARTS + 1):
            with component("house", folder, "zeromq") as ready:
                took.append(ready.seconds)
    seconds = statistics.median(took[1:])  # the first one compiles
    return Row("start of the component, to `ready`", seconds * 1e6, "≤ 1.0 s", seconds <= 1.0)


def _served(effort: Effort) -> list[Row]:
    """Two lasers and two cameras of a scene with physics, heard by another component. The time is that from a filled
    picture to its handler."""
    with house(SHAPES, cameras=True) as folder:
        each = [served(folder, effort.watched / STARTS) for _ in range(STARTS + 1)][1:]
    first = statistics.median(one.first for one in each)
    delay, share = (statistics.median(values) for values in zip(*((one.delay, one.share) for one in each), strict=True))
    pictures, scans = (min(values) for values in zip(*((one.pictures, one.scans) for one in each), strict=True))
    heard = f"scans at {scans:.1f} Hz, pictures at {pictures:.1f} Hz, {share:.0f} % of a core"
    is_met = delay <= MOST_DELAY and share <= MOST_SHARE and min(scans, pictures) >= 0.99 * HERTZ
    return [
        Row("start of the component, to its first picture", first * 1e6, "≤ 2.0 s", first <= 2.0),
        Row(
            f"2 lasers, 2 cameras over shm: {heard}",
            delay * 1e6,
            f"{HERTZ} Hz, ≤ {MOST_SHARE:g} %, ≤ {us(MOST_DELAY * 1e6)}",
            is_met,
        ),
    ]


def table(rows: list[Row]) -> Table:
    cells = [
        (
            row.what,
            us(row.ours),
            us(row.bare),
            times_as_much(row.ratio),
            f"{row.goal}: {'met' if row.met else 'missed'}" if row.goal else "–",
        )
        for row in rows
    ]
    head = ("simulation", "ours", "MuJoCo", "ratio", "goal")
    title = f"a scene with two robots with arms, 20 free boxes, and {SHAPES} shapes unless said"
    return Table("simulation", title, head, cells, labels=1)


def findings(rows: list[Row]) -> list[Finding]:
    return [
        Finding("simulation", row.what, "", times_as_much(row.ratio), row.ratio <= RATIO, row.ratio)
        for row in rows
        if row.ratio is not None and row.goal
    ]
