"""Simulates a scene for a long time, and tells the memory of the process at every tenth of it.

    python -m benchmarks.soak --hours 24 --tick 0.02

Robots drive and move their arms by chance, lasers measure, nodes are added and removed, states are saved and restored,
and plans are tried. The end is compared with the half, before which libraries fill their caches.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from robocomp_py.sim.plans import Command, evaluate
from robocomp_py.sim.state import TICK
from robocomp_py.sim.world import World

from .scenes import hall

MOST_GROWTH = 2.0
"""MB from the half to the end: what an allocator may keep."""

_PARTS = 10
_SECOND = 1.0
_EDITS_EACH = 60
"""Simulated seconds from one edit to the next."""


@dataclass(frozen=True)
class Result:
    hours: float
    """Simulated."""
    processor: float
    """s."""
    resident: list[float]
    """MB, at every tenth."""
    growth: float
    """MB, from the half to the end."""


def run(hours: float, tick: float, *, shapes: int = 61) -> Result:
    """Simulate for a time."""
    world, chosen, resident = (
        World(hall(shapes, resting=False), tick=tick, physics=True),
        random.Random(1),
        list[float](),
    )
    seconds, began = max(_PARTS, round(hours * 3600)), time.process_time()
    for second in range(1, seconds + 1):
        _act(world, chosen, second)
        world.step(round(_SECOND / tick))
        if second * _PARTS // seconds > len(resident):
            resident.append(_resident())
            print(f"{second / 3600:.2f} h: {resident[-1]:.1f} MB", file=sys.stderr, flush=True)
    growth = resident[-1] - resident[_PARTS // 2 - 1]
    return Result(seconds / 3600, time.process_time() - began, resident, growth)


def _act(world: World, chosen: random.Random, second: int) -> None:
    for base in world.bases:
        ahead, aside = chosen.uniform(-300, 300), chosen.uniform(-300, 300)
        world.drive(base, ahead, aside, chosen.uniform(-0.5, 0.5))
    for joint in world.joints:
        world.move_joint(joint, chosen.uniform(-1, 1), 0.5)
    for laser in world.lasers:
        world.scan(laser)
    world.digest()
    if second % _EDITS_EACH == 0:
        tree = world.tree.copy()
        if "post" in tree:
            tree.remove("post")
        else:
            tree.add("world", "plane", "post", size=(100.0, 900.0, 100.0), px=chosen.uniform(-9000, 9000), pz=-9000.0)
        world.change(tree)
    if second % _EDITS_EACH == _EDITS_EACH // 3:
        saved = world.save()
        world.step(2)
        world.restore(saved)
    if second % _EDITS_EACH == 2 * _EDITS_EACH // 3:
        evaluate(world, [[Command(0.0, base, (200.0, 0.0, 0.1))] for base in world.bases], 0.2)


def _resident() -> float:
    """Memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__.split("\n")[0])
    parser.add_argument("--hours", type=float, default=24.0, help="simulated hours (default: 24)")
    parser.add_argument("--tick", type=float, default=TICK, help=f"length of a tick, s (default: {TICK})")
    options = parser.parse_args(arguments)
    result = run(options.hours, options.tick)
    print(json.dumps(asdict(result)))
    return 0 if result.growth <= MOST_GROWTH else 1


if __name__ == "__main__":
    sys.exit(main())
