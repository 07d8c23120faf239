"""From the start of a process to a component that says it is ready, and what of that is not ours.

The component is `components/speech`: generated, serving four operations, waiting for nobody. Each
middleware is used for all of it; on Zenoh it also runs the router. Files are in the disk cache, and
Python's bytecode is compiled, as from the second start on.
"""

from __future__ import annotations

import contextlib
import os
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from .ours import options
from .pair import place
from .parties import PATIENCE, Place
from .query import Tell
from .rounds import Effort, by_turns
from .tables import Table

GOAL = 0.5
"""Seconds."""

LIBRARY = {"zeromq": ", zmq", "dds": ", cyclonedds.domain", "zenoh": ", zenoh", "inproc": ""}
_COMPONENTS = Path(__file__).parents[1] / "components"
_SAY = "import os; os.write({0}, b'!')"


@dataclass(frozen=True)
class Row:
    """Times in seconds, each from the start of a process of its own."""

    middleware: str
    interpreter: float
    numpy: float
    """Interpreter and numpy."""
    library: float
    """Interpreter, numpy and the middleware's library: what any program in Python needs for it."""
    ready: float


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    for middleware in middlewares:
        tell(f"start · {middleware}")
        programs = ("", "import numpy", f"import numpy{LIBRARY[middleware]}")
        with place() as here:
            environment = _environment(here)
            steps = [
                *(partial(_bare, program, environment) for program in programs),
                partial(_component, middleware, here, environment),
            ]
            for step in steps:
                step()  # from now on all files are in the cache, and their bytecode is there
            found = by_turns(steps, effort.rounds)
        rows.append(Row(middleware, *(statistics.median(each[0] for each in step) for step in found)))
    return rows


def _environment(here: Place) -> dict[str, str]:
    """One in which bytecode is kept from one start to the next, as usual, but in a folder of ours."""
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return inherited | {"PYTHONPYCACHEPREFIX": f"{here.folder}/bytecode"}


def _bare(code: str, environment: dict[str, str]) -> list[float]:
    """Seconds until a new interpreter has run this."""
    out, into = os.pipe()
    try:
        begun = time.perf_counter()
        program = f"{code}\n{_SAY.format(into)}"
        with _process([sys.executable, "-c", program], pass_fds=(into,), env=environment):
            os.close(into)
            into = -1
            if os.read(out, 1) != b"!":
                raise RuntimeError(f"python -c {code!r} failed; see above")
            return [time.perf_counter() - begun]
    finally:
        os.close(out)
        if into >= 0:
            os.close(into)


def _component(middleware: str, here: Place, environment: dict[str, str]) -> list[float]:
    """Seconds until a component says that it is ready."""
    command = [sys.executable, "-m", "speech", "--middleware", middleware, "--set", "component.log=warning"]
    for name, value in options(middleware, here).items():
        command += ["--set", f"transports.{middleware}.{name}={value}"]
    address = f"{here.folder}/notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as told:
        told.bind(address)
        told.settimeout(3 * PATIENCE)
        try:
            begun = time.perf_counter()
            with _process(command, cwd=_COMPONENTS, env=environment | {"NOTIFY_SOCKET": address}):
                while b"READY=1" not in told.recv(4096):
                    pass
                return [time.perf_counter() - begun]
        finally:
            os.unlink(address)


@contextlib.contextmanager
def _process(command: list[str], **options: object) -> Iterator[None]:
    """A process that is asked to end, and made to if it does not. Not told by Ctrl-C, but by us."""
    process: subprocess.Popen[bytes] = subprocess.Popen(command, start_new_session=True, **options)  # type: ignore[call-overload]
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def table(rows: list[Row]) -> Table:
    head = ("", "ready", "interpreter", "+ numpy", "+ library", "+ ours", "goal")
    cells = [
        (
            row.middleware,
            _s(row.ready),
            _s(row.interpreter),
            _s(row.numpy - row.interpreter),
            _s(row.library - row.numpy),
            _s(row.ready - row.library),
            f"≤ {GOAL:g} s: {'met' if row.ready <= GOAL else 'missed'}",
        )
        for row in rows
    ]
    return Table("start", "start of a component, from its process to `ready`", head, cells, labels=1)


def _s(seconds: float) -> str:
    return f"{max(0.0, seconds):.2f} s"
