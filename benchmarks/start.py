"""Measures the time from the start of a process to a ready component, and the part of Python and libraries in it.

The component is `components/speech`: generated, with four operations, and without required peers. It uses one
middleware for everything; on Zenoh it also runs the router. Files are in the disk cache, and Python's bytecode is
compiled, as from the second start on.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

from .components import COMPONENTS, component
from .goals import Finding
from .process import megabytes, running
from .query import Tell
from .rounds import Effort, by_turns
from .tables import Table

SECONDS, MEGABYTES = 0.3, 60
"""Goals; of DDS, half a second."""

ROUNDS = 7
"""At most: processes are started in each."""

LIBRARY = {"zeromq": ", zmq", "dds": ", cyclonedds.domain", "zenoh": ", zenoh", "shm": ", iceoryx2", "inproc": ""}
_SAY = "import os; os.write({0}, b'!')"


@dataclass(frozen=True)
class Row:
    """Times in seconds, each from the start of a separate process."""

    middleware: str
    interpreter: float
    numpy: float
    """Interpreter and numpy."""
    library: float
    """Interpreter, numpy and the middleware's library: what any program in Python needs for it."""
    ready: float
    share: float
    """Memory in MB when it is ready, what it shares with other processes divided by their number (PSS)."""
    memory: float
    """What it shares counted in full (RSS)."""

    @property
    def allowed(self) -> float:
        return 0.5 if self.middleware == "dds" else SECONDS


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:
        # Bytecode is kept from one start to the next, as usual, but in a folder of ours.
        kept = {"PYTHONPYCACHEPREFIX": folder, "PYTHONDONTWRITEBYTECODE": ""}
        for middleware in middlewares:
            tell(f"start · {middleware}")
            programs = ("", "import numpy", f"import numpy{LIBRARY[middleware]}")
            steps = [*(partial(_bare, program, kept) for program in programs), partial(_component, middleware, kept)]
            for step in steps:
                step()  # from now on all files are in the cache, and their bytecode is there
            *bare, ours = by_turns(steps, min(effort.rounds, ROUNDS))
            times = (statistics.median(each[0] for each in step) for step in bare)
            rows.append(Row(middleware, *times, *map(statistics.median, zip(*ours, strict=True))))
    return rows


def _bare(code: str, kept: dict[str, str]) -> list[float]:
    """Seconds until a new interpreter has run this."""
    out, into = os.pipe()
    try:
        begun = time.perf_counter()
        program = f"{code}\n{_SAY.format(into)}"
        with running([sys.executable, "-c", program], pass_fds=(into,), env=os.environ | kept):
            os.close(into)
            into = -1
            if os.read(out, 1) != b"!":
                raise RuntimeError(f"python -c {code!r} failed; see above")
            return [time.perf_counter() - begun]
    finally:
        os.close(out)
        if into >= 0:
            os.close(into)


def _component(middleware: str, kept: dict[str, str]) -> list[float]:
    """Seconds until a component is ready, and its memory then, in MB: its share, and its resident memory."""
    with component("speech", COMPONENTS, middleware, **kept) as ready:
        return [ready.seconds, megabytes(ready.pid), megabytes(ready.pid, "Rss")]


def table(rows: list[Row]) -> Table:
    head = ("", "ready", "interpreter", "+ numpy", "+ library", "+ ours", "goal", "PSS", "RSS", "goal")
    cells = [
        (
            row.middleware,
            _s(row.ready),
            _s(row.interpreter),
            _s(row.numpy - row.interpreter),
            _s(row.library - row.numpy),
            _s(row.ready - row.library),
            f"≤ {row.allowed:g} s: {'met' if row.ready <= row.allowed else 'missed'}",
            f"{row.share:.0f} MB",
            f"{row.memory:.0f} MB",
            f"PSS ≤ {MEGABYTES} MB: {'met' if row.share <= MEGABYTES else 'missed'}",
        )
        for row in rows
    ]
    return Table("start", "start of a component, from its process to `ready`", head, cells, labels=1)


def findings(rows: list[Row]) -> list[Finding]:
    """The guard compares a start with that of a bare program."""
    memory = [
        Finding("memory", row.middleware, "", f"{row.share:.0f} MB", row.share <= MEGABYTES, value=row.share)
        for row in rows
    ]
    return memory + [
        Finding(
            "start",
            row.middleware,
            "",
            _s(row.ready),
            row.ready <= row.allowed,
            row.ready / row.library,
            value=row.ready,
        )
        for row in rows
    ]


def _s(seconds: float) -> str:
    return f"{max(0.0, seconds):.2f} s"
