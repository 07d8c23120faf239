"""Measures lock-step: how long a network takes for one instant at which all its components compute.

A leader and its followers, each a process whose `compute` does nothing, at full speed. Generated here, and written like
user code.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from .components import component
from .goals import Finding, failed
from .pair import place
from .parties import FAILURES, PATIENCE
from .process import ROOT
from .query import Tell
from .rounds import Effort
from .tables import Table

GOALS = {"shm": 0.2, "zeromq": 0.5}
"""Milliseconds for a tick with four followers."""

FOLLOWERS = (1, 4)
JUDGED = 4
"""The number of followers for which there is a goal."""

WARM = 200
"""Ticks before the measured ones."""

_CDSL = """\
Component {name}
{{
    language python;
}};
"""
_FOLLOWER = """\
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def compute(self) -> None:
        pass
"""
_LEADER = f"""\
import os
import statistics
import time
from itertools import pairwise
from pathlib import Path

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        self.ticks = 0
        self.times: list[float] = []
        self.measured = int(os.environ["TICKS"])

    def compute(self) -> None:
        self.ticks += 1
        if {WARM} <= self.ticks <= {WARM} + self.measured:
            self.times.append(time.perf_counter())
        if self.ticks == {WARM} + self.measured:
            took = statistics.median(after - before for before, after in pairwise(self.times))
            result = Path(os.environ["RESULT"])
            result.with_suffix(".new").write_text(str(took * 1e3))
            result.with_suffix(".new").rename(result)
"""


@dataclass(frozen=True)
class Row:
    """Milliseconds for a tick: the median, which other programs on the machine disturb least."""

    middleware: str
    followers: int
    tick: float | None = None
    failure: str = ""

    @property
    def goal(self) -> float | None:
        return GOALS.get(self.middleware) if self.followers == JUDGED else None

    @property
    def met(self) -> bool:
        return self.tick is not None and self.goal is not None and self.tick <= self.goal


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    ticks = 100 * effort.rounds
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:
        _generate(Path(folder))
        for middleware in middlewares:
            if middleware == "inproc":
                continue  # which has no processes
            for followers in FOLLOWERS:
                tell(f"lockstep · {middleware} · {followers}")
                try:
                    rows.append(Row(middleware, followers, _tick(middleware, Path(folder), followers, ticks)))
                except FAILURES as exc:
                    rows.append(Row(middleware, followers, failure=f"{exc}"))
    return rows


def _tick(middleware: str, folder: Path, followers: int, ticks: int) -> float:
    names = [f"follower{number}" for number in range(followers)]
    listed = ", ".join(f'"{name}"' for name in names)
    result = folder / "tick"
    result.unlink(missing_ok=True)
    with contextlib.ExitStack() as undo:
        here = undo.enter_context(place())
        common = ("component.period=0.001", "clock.leader=leader")
        for name in names:
            undo.enter_context(component("follower", folder, middleware, *common, instance=name, runtime=here.folder))
        leads = (*common, f"clock.followers=[{listed}]", "clock.speed=0")
        told = {"TICKS": str(ticks), "RESULT": str(result)}
        undo.enter_context(component("leader", folder, middleware, *leads, runtime=here.folder, **told))
        end = time.monotonic() + 3 * PATIENCE
        while not result.exists():
            if time.monotonic() > end:
                raise TimeoutError(f"{middleware}: {WARM + ticks} ticks took more than {3 * PATIENCE:g} s")
            time.sleep(0.05)
        return float(result.read_text())


def _generate(folder: Path) -> None:
    """Two components: their generated parts by `rcgen`, their specific parts from here."""
    for name, code in (("leader", _LEADER), ("follower", _FOLLOWER)):
        model = folder / f"{name}.cdsl"
        model.write_text(_CDSL.format(name=name), encoding="utf-8")
        command = [sys.executable, "-m", "robocomp_py.cli.rcgen", str(model), "-o", str(folder / name)]
        subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
        (folder / name / "specificworker.py").write_text(code, encoding="utf-8")


def table(rows: list[Row]) -> Table:
    cells = [
        (
            row.middleware,
            str(row.followers),
            "–" if row.tick is None else f"{row.tick:.2f} ms",
            "" if row.goal is None else f"≤ {row.goal:g} ms: {'met' if row.met else 'missed'}",
        )
        for row in rows
    ]
    note = "; ".join(f"{row.middleware} failed: {row.failure}" for row in rows if row.failure)
    title = "lock-step: one instant at which all components compute"
    return Table("lockstep", title, ("", "followers", "tick", "goal"), cells, labels=2, note=note)


def findings(rows: list[Row]) -> list[Finding]:
    return [
        failed("lockstep", row.middleware)
        if row.tick is None
        else Finding("lockstep", row.middleware, "", f"{row.tick:.2f} ms", row.met, value=row.tick / row.goal)
        for row in rows
        if row.goal is not None
    ]
