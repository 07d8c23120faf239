"""Measures commands that look at what runs, as whole processes: Python's start and all imports are part of it.

Bytecode is compiled and in the disk cache, as from the second start on. What is listed is one component, one that
publishes is heard, and 500 are listed that this process announces in a directory, with as many ends as a component
without ports has. The rows of commands that go on for long are measured in `looks` and `recordings`.

`rc echo` ends soon after a message. If it began right then, it would always wait for the same part of the period of
the topic, and the time from its begin to its end would be a multiple of this period. So each round begins at another
time between two messages. These times are spread evenly, and the median is that over all of them.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from pathlib import Path

from . import counters, looks, recordings
from .components import COMPONENTS, component
from .looks import announced
from .pair import place
from .parties import PATIENCE
from .process import ROOT
from .query import Tell
from .rounds import Effort, by_turns
from .tables import Table

MOST = 500
"""Components."""

ROUNDS = 7
"""At most: processes are started in each."""

GOALS = {"zenoh": 0.4, "dds": 0.5}
"""Seconds of `rc list`; of the other middlewares, `USUAL`."""

HELP, USUAL, MANY = 0.1, 0.3, 1.0

HEARD = {"ice": 0.3, "zenoh": 0.4, "dds": 0.6}
"""Seconds of `rc echo` until the first message of a topic at 20 Hz; over the other middlewares, `SOON`."""

SOON = 0.25

PERIOD = 0.05
"""Seconds between two messages of that topic."""

LOOK, LOOK_AT_MANY, PAGE = 10.0, 500.0, 100.0
"""ms of processor time for a look at 5 components and at 500, and kB of the page of `rc monitor`."""

LATE, RERUN, LOST = 2.0, 20.0, 1.0
"""ms by which replayed messages may be late, times as fast as real time, seconds that a killed recorder may lose."""

COUNTERS, COUNTERS_KEPT = 1.0, 50.0
"""ms at the start of a component, and kB when all durations are kept."""


@dataclass(frozen=True)
class Row:
    """In seconds, or in another unit. If `is_rate`, more is better."""

    what: str
    taken: float
    allowed: float
    unit: str = "s"
    is_rate: bool = False

    @property
    def met(self) -> bool:
        return self.taken >= self.allowed if self.is_rate else self.taken <= self.allowed


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as kept, place() as here:
        cache = {"PYTHONPYCACHEPREFIX": kept, "PYTHONDONTWRITEBYTECODE": ""}

        def measured(what: str, words: list[str], runtime: str, allowed: float, period: float = 0.0) -> Row:
            tell(f"tools · {what}")
            rounds = min(effort.rounds, ROUNDS)
            waits = cycle(period * each / rounds for each in range(rounds))
            step = partial(_taken, words, cache | {"ROBOCOMP_RUNTIME_DIR": runtime}, waits)
            step()  # from now on all files are in the cache, and their bytecode is there
            (found,) = by_turns([step], rounds)
            return Row(what, statistics.median(each[0] for each in found), allowed)

        rows.append(measured("rc --help", ["--help"], here.folder, HELP))
        for middleware in (each for each in middlewares if each != "inproc"):
            with (
                tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as runtime,
                component("speech", COMPONENTS, middleware, runtime=runtime, domain="default", **cache),
            ):
                allowed = GOALS.get(middleware, USUAL)
                rows.append(measured(f"rc list, one component over {middleware}", ["list"], runtime, allowed))
            with (
                tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as runtime,
                component("world2d", COMPONENTS, middleware, runtime=runtime, domain="default", **cache),
            ):
                words = ["echo", "LaserPub", "-n", "1", "--middleware", middleware]
                allowed = HEARD.get(middleware, SOON)
                what = f"rc echo, a message at 20 Hz over {middleware}"
                rows.append(measured(what, words, runtime, allowed, PERIOD))
        with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as runtime, announced(Path(runtime), MOST):
            rows.append(measured(f"rc list --all, {MOST} components", ["list", "--all"], runtime, MANY))
    if "shm" in middlewares:
        rows += _at_work(effort, tell)
    return rows


def _at_work(effort: Effort, tell: Tell) -> Iterator[Row]:
    """Of commands that go on, over shared memory."""
    tell("tools · looks")
    with looks.few("shm") as runtime:
        monitor, page = looks.monitor("shm", runtime)
        top = looks.top("shm", runtime)
    many_monitor, many_top = looks.many(MOST, min(effort.rounds, ROUNDS))
    few = 1 + looks.WANDERS
    yield Row(f"rc monitor, a look at {few} components, processor", 1000 * monitor, LOOK, "ms")
    yield Row(f"rc monitor, a look at {MOST} components, processor", 1000 * many_monitor, LOOK_AT_MANY, "ms")
    yield Row(f"rc top, a look at {few} components, processor", 1000 * top, LOOK, "ms")
    yield Row(f"rc top, a look at {MOST} components, processor", 1000 * many_top, LOOK_AT_MANY, "ms")
    yield Row("rc monitor, its page", page / 1000, PAGE, "kB")
    tell("tools · recordings")
    yield Row("rc replay at rate 1, messages late, p99", 1000 * recordings.lateness(), LATE, "ms")
    speed, differences = recordings.speed()
    yield Row(f"rc rerun wander, {differences} differences", 0.0 if differences else speed, RERUN, "× real time", True)
    yield Row("rc record, lost if it is killed", recordings.loss(), LOST)
    kept = counters.kept(effort)
    what = f"the {kept.operations} counters of {counters.COMPONENT}"
    yield Row(f"{what}, made at its start", 1000 * kept.seconds, COUNTERS, "ms")
    yield Row(f"{what}, memory", kept.octets / 1000, COUNTERS_KEPT, "kB")


def _taken(words: list[str], environment: dict[str, str], waits: Iterator[float]) -> list[float]:
    """Seconds until a command has ended, which begins after the next of these waits."""
    command = [sys.executable, "-m", "robocomp_py.cli.rc", *words]
    time.sleep(next(waits))
    begun = time.perf_counter()
    subprocess.run(
        command, cwd=ROOT, env=os.environ | environment, stdout=subprocess.DEVNULL, check=True, timeout=PATIENCE
    )
    return [time.perf_counter() - begun]


def table(rows: list[Row]) -> Table:
    cells = [
        (
            row.what,
            f"{row.taken:.3g} {row.unit}" if row.unit != "s" else f"{row.taken:.2f} s",
            f"{'≥' if row.is_rate else '≤'} {row.allowed:g} {row.unit}: {'met' if row.met else 'missed'}",
        )
        for row in rows
    ]
    return Table("tools", "commands that look at what runs, as whole processes", ("", "measured", "goal"), cells, 1)
