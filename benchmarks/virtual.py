"""Measures virtual time: the example network of `components/rescue.ddsl`, from its start until help was called."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from typing import Any

from .components import COMPONENTS
from .goals import Finding
from .query import Tell
from .rounds import Effort
from .tables import Table

GOAL = 36.0
"""Times as fast as real time."""

ROUNDS = 5
"""At most: each takes about two seconds."""


@dataclass(frozen=True)
class Row:
    """Virtual seconds of the mission, the seconds that it took, and its messages."""

    virtual: float
    seconds: float
    messages: int

    @property
    def factor(self) -> float:
        return self.virtual / self.seconds


def run(effort: Effort, tell: Tell) -> list[Row]:
    tell("virtual · rescue")
    results = [_simulated() for _ in range(min(effort.rounds, ROUNDS))]
    if len({each["hash"] for each in results}) != 1:
        raise RuntimeError("two runs of the simulation differ")
    took = statistics.median(each["took"] for each in results)
    return [Row(results[0]["seconds"], took, results[0]["messages"])]


def _simulated() -> dict[str, Any]:
    network = COMPONENTS / "rescue.ddsl"
    options = ("--until", "rescue", "--for", "60", "--set", "world.params.picture=", "--json")
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "simulate", str(network), *options]
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder, timeout=60.0, check=True)
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def table(rows: list[Row]) -> Table:
    cells = [
        (
            "rescue",
            f"{row.virtual:.1f} s",
            f"{row.seconds:.2f} s",
            f"{row.factor:.0f} ×",
            f"≥ {GOAL:g} ×: {'met' if row.factor >= GOAL else 'missed'}",
            str(row.messages),
        )
        for row in rows
    ]
    head = ("network", "virtual", "took", "real time", "goal", "messages")
    return Table("virtual", "virtual time: five components and a camera, in one process", head, cells, labels=1)


def findings(rows: list[Row]) -> list[Finding]:
    return [
        Finding("virtual", "rescue", "", f"{row.factor:.0f} ×", row.factor >= GOAL, GOAL / row.factor) for row in rows
    ]
