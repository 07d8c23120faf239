"""Measures a picture of 640 × 480 pixels with its depth: ours, and two passes of MuJoCo's own renderer.

A process of its own measures both, by turns: OpenGL is chosen before MuJoCo is imported. Both draw the same model.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from .goals import Finding
from .query import Tell
from .rounds import Effort, by_turns, ratio, seconds_of, times
from .tables import Table, times_as_much, us

GOAL = 1.3
"""Times as long as MuJoCo alone, as that of every measurement of simulation."""

SCENES = ("plain", "textured")
BOXES = 140
PICTURES = 6
"""Of each, in a round."""


@dataclass(frozen=True)
class Row:
    scene: str
    ours: float
    """µs, the median."""
    bare: float
    ratio: float


def run(effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    for scene in SCENES:
        tell(f"pictures · {scene}")
        command = [sys.executable, "-m", "benchmarks.pictures", scene, str(effort.rounds)]
        environment = {**os.environ, "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300.0, check=True)
        rows.append(Row(scene, **json.loads(done.stdout)))
    return rows


def table(rows: list[Row]) -> Table:
    cells = [
        (
            row.scene,
            us(row.ours),
            us(row.bare),
            times_as_much(row.ratio),
            f"≤ {GOAL:g} ×: {'met' if row.ratio <= GOAL else 'missed'}",
        )
        for row in rows
    ]
    head = ("scene", "ours", "MuJoCo", "ratio", "goal")
    return Table("pictures", f"a picture of {BOXES} boxes, 640 x 480, colour and depth", head, cells, labels=1)


def findings(rows: list[Row]) -> list[Finding]:
    return [Finding("pictures", row.scene, "", times_as_much(row.ratio), row.ratio <= GOAL, row.ratio) for row in rows]


def _measured(scene: str, rounds: int) -> dict[str, float]:
    import mujoco

    from robocomp_py.innermodel.tree import Tree
    from robocomp_py.sim.build import build
    from robocomp_py.sim.render import Renderer
    from robocomp_py.sim.world import World

    with tempfile.TemporaryDirectory() as folder, Renderer() as renderer:
        tree = Tree.read(_scene(Path(folder), scene))
        world = World(tree)
        colours, depths = renderer.picture(world.view(), "eye")
        drawn = build(tree, world.tick, shown={})
        data = mujoco.MjData(drawn.model)
        data.qpos[:] = drawn.start
        mujoco.mj_forward(drawn.model, data)
        with mujoco.Renderer(drawn.model, 480, 640) as alone:
            for flag in ("SHADOW", "REFLECTION", "SKYBOX", "HAZE"):
                alone.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = False

            def bare() -> None:
                alone.disable_depth_rendering()
                alone.update_scene(data, drawn.cameras["eye"])
                alone.render(out=colours)
                alone.enable_depth_rendering()
                alone.render(out=depths)

            def ours() -> None:
                renderer.picture(world.view(), "eye", colours, depths)

            parties = [lambda: seconds_of(ours, PICTURES), lambda: seconds_of(bare, PICTURES)]
            mine, its = by_turns(parties, rounds)
    return {"ours": times(mine).p50, "bare": times(its).p50, "ratio": ratio(mine, its)}


def _scene(folder: Path, kind: str) -> Path:
    """A floor, and boxes before a camera."""
    from PIL import Image

    chosen = random.Random(1)
    Image.effect_noise((256, 256), 60).convert("RGB").save(folder / "noise.png")

    def look() -> str:
        return "noise.png" if kind == "textured" else f"#{chosen.randrange(1 << 24):06x}"

    def box(number: int) -> str:
        x, y, z = chosen.uniform(-4000, 4000), chosen.uniform(0, 1500), chosen.uniform(1500, 8000)
        return (
            f'<transform id="at{number}" tx="{x:.0f}" ty="{y:.0f}" tz="{z:.0f}" ry="{chosen.uniform(-3, 3):.2f}">'
            f'<plane id="box{number}" size="300,400,200" texture="{look()}"/></transform>'
        )

    nodes = [
        f'<plane id="floor" ny="1" size="20000,20000,10" texture="{look()}"/>',
        *map(box, range(BOXES)),
        '<translation id="mount" ty="1000"><rgbd id="eye" width="640" height="480" focal="500"/></translation>',
    ]
    path = folder / "scene.xml"
    path.write_text(f"<innerModel>{''.join(nodes)}</innerModel>", encoding="utf-8")
    return path


if __name__ == "__main__":
    print(json.dumps(_measured(sys.argv[1], int(sys.argv[2]))))
