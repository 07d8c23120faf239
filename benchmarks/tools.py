"""Measures commands that look at what runs, as whole processes: Python's start and all imports are part of it.

Bytecode is compiled and in the disk cache, as from the second start on. What is listed is one component, one that
publishes is heard, and 500 are listed that this process announces in a directory, with as many ends as a component
without ports has.
"""

from __future__ import annotations

import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from robocomp_py.runtime.RoboCompCommonBehavior import COMMONBEHAVIOR_INTERFACE
from robocomp_py.runtime.RoboCompIntrospection import INTROSPECTION_INTERFACE
from robocomp_py.transports.directory import Directory
from robocomp_py.transports.members import Entry

from .components import COMPONENTS, component
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


@dataclass(frozen=True)
class Row:
    """Times in seconds."""

    what: str
    taken: float
    allowed: float


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as kept, place() as here:
        cache = {"PYTHONPYCACHEPREFIX": kept, "PYTHONDONTWRITEBYTECODE": ""}

        def measured(what: str, words: list[str], runtime: str, allowed: float) -> Row:
            tell(f"tools · {what}")
            step = partial(_taken, words, cache | {"ROBOCOMP_RUNTIME_DIR": runtime})
            step()  # from now on all files are in the cache, and their bytecode is there
            (found,) = by_turns([step], min(effort.rounds, ROUNDS))
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
                rows.append(measured(f"rc echo, a message at 20 Hz over {middleware}", words, runtime, allowed))
        with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as runtime, _announced(Path(runtime)):
            rows.append(measured(f"rc list --all, {MOST} components", ["list", "--all"], runtime, MANY))
    return rows


@contextlib.contextmanager
def _announced(runtime: Path) -> Iterator[None]:
    """Members of a directory that are as many components would be."""
    folder = runtime / "zeromq"
    folder.mkdir(mode=0o700)
    directory = Directory(folder)
    with contextlib.ExitStack() as undo:
        for number in range(MOST):
            name = f"component{number}"
            member = directory.join(name)
            undo.callback(member.close)
            for interface in (COMMONBEHAVIOR_INTERFACE, INTROSPECTION_INTERFACE):
                for each in interface.operations:
                    channel = f"{name}/{interface.short}/{each.name}"
                    member.add(Entry("serves", channel, each.fingerprint, each.text, "ipc:///nowhere"))
        yield


def _taken(words: list[str], environment: dict[str, str]) -> list[float]:
    """Seconds until a command has ended."""
    command = [sys.executable, "-m", "robocomp_py.cli.rc", *words]
    begun = time.perf_counter()
    subprocess.run(
        command, cwd=ROOT, env=os.environ | environment, stdout=subprocess.DEVNULL, check=True, timeout=PATIENCE
    )
    return [time.perf_counter() - begun]


def table(rows: list[Row]) -> Table:
    cells = [
        (row.what, f"{row.taken:.2f} s", f"≤ {row.allowed:g} s: {'met' if row.taken <= row.allowed else 'missed'}")
        for row in rows
    ]
    return Table("tools", "commands that look at what runs, as whole processes", ("", "median", "goal"), cells, 1)
