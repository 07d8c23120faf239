"""Measures the CPU time of nearly idle components, as counted by the kernel for their processes.

Idle: `components/speech` without a client; its `compute` runs ten times a second and does nothing.
Busy: a publisher, whose `compute` runs a hundred times a second and sends 1 KB, and a subscriber, both generated
here and written like user code. The measurement begins when they have settled.
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

from .components import COMPONENTS, Ready, component
from .goals import Finding, failed
from .pair import place
from .parties import FAILURES
from .process import ROOT, cpu_seconds
from .query import Tell
from .rounds import Effort
from .tables import Table

IDLE, BUSY = 0.3, 6.0
"""Goals, in % of one core."""

HERTZ, SIZE = 100, 1024
SETTLED = 1.0
"""Seconds after `ready` in which caches fill, and links are made."""

_SOUND = "module Benchmark { interface Sound { void heard(sequence<byte> data); }; };\n"
_CDSL = """\
import "Sound.idsl";

Component {name}
{{
    Communications {{ {verb} Sound; }};
    language python;
}};
"""
_TALKER = f"""\
import numpy as np

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        self.data = np.arange({SIZE}, dtype=np.uint16).astype(np.uint8)

    def compute(self) -> None:
        self.sound_proxy.heard(self.data)
"""
_LISTENER = """\
import os

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    heard = 0

    def compute(self) -> None:
        pass

    def Sound_heard(self, data) -> None:
        self.heard += 1

    def finish(self) -> None:
        with open(os.environ["HEARD"], "w") as file:
            file.write(str(self.heard))
"""


@dataclass(frozen=True)
class Row:
    """In % of one core. A middleware within one process has no pair of processes."""

    middleware: str
    idle: float
    publisher: float | None = None
    subscriber: float | None = None
    failure: str = ""

    @property
    def both(self) -> float | None:
        return None if self.publisher is None or self.subscriber is None else self.publisher + self.subscriber


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    chosen = tuple(middlewares)
    tell("cpu · idle")
    idle = _idle(chosen, effort.watched)
    rows = []
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:
        _generate(Path(folder))
        for middleware in chosen:
            if middleware == "inproc":
                rows.append(Row(middleware, idle[middleware]))
                continue
            tell(f"cpu · {middleware}")
            try:
                rows.append(Row(middleware, idle[middleware], *_busy(middleware, Path(folder), effort.watched)))
            except FAILURES as exc:
                rows.append(Row(middleware, idle[middleware], failure=f"{exc}"))
    return rows


def _idle(middlewares: tuple[str, ...], seconds: float) -> dict[str, float]:
    """Measure all at once: they do not disturb each other."""
    with contextlib.ExitStack() as undo:
        ready = [undo.enter_context(component("speech", COMPONENTS, middleware)) for middleware in middlewares]
        return dict(zip(middlewares, _shares(ready, seconds), strict=True))


def _busy(middleware: str, folder: Path, seconds: float) -> tuple[float, float]:
    count = folder / "heard"
    with contextlib.ExitStack() as undo:
        here = undo.enter_context(place())
        both = [
            undo.enter_context(component(name, folder, middleware, *more, runtime=here.folder, HEARD=str(count)))
            for name, more in (("listener", ()), ("talker", (f"component.period={1 / HERTZ}",)))
        ]
        listener, talker = _shares(both, seconds)
    heard, expected = int(count.read_text()), seconds * HERTZ
    if heard < expected / 2:
        raise RuntimeError(f"{middleware}: {heard} messages were heard in {seconds:g} s, not {expected:g}")
    return talker, listener


def _shares(ready: list[Ready], seconds: float) -> list[float]:
    """The share of one core in % that each used in these seconds, after all have settled."""
    time.sleep(min(SETTLED, seconds))
    begun, before = time.monotonic(), [cpu_seconds(each.pid) for each in ready]
    time.sleep(seconds)
    passed, after = time.monotonic() - begun, [cpu_seconds(each.pid) for each in ready]
    return [(late - early) / passed * 100 for early, late in zip(before, after, strict=True)]


def _generate(folder: Path) -> None:
    """Two components: their generated parts by `rcgen`, their specific parts from here."""
    (folder / "Sound.idsl").write_text(_SOUND, encoding="utf-8")
    for name, verb, code in (("talker", "publishes", _TALKER), ("listener", "subscribesTo", _LISTENER)):
        model = folder / f"{name}.cdsl"
        model.write_text(_CDSL.format(name=name, verb=verb), encoding="utf-8")
        command = [sys.executable, "-m", "robocomp_py.cli.rcgen", str(model), "-o", str(folder / name)]
        subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
        (folder / name / "specificworker.py").write_text(code, encoding="utf-8")


def table(rows: list[Row]) -> Table:
    head = ("", "idle", "goal", "publisher", "subscriber", "both", "goal")
    cells = [
        (
            row.middleware,
            _percent(row.idle),
            f"≤ {IDLE:g} %: {'met' if row.idle <= IDLE else 'missed'}",
            *(_percent(each) for each in (row.publisher, row.subscriber, row.both)),
            "" if row.both is None else f"≤ {BUSY:g} %: {'met' if row.both <= BUSY else 'missed'}",
        )
        for row in rows
    ]
    note = "; ".join(f"{row.middleware} failed: {row.failure}" for row in rows if row.failure)
    return Table("cpu", f"share of one core: idle, and {SIZE} B at {HERTZ} Hz", head, cells, labels=1, note=note)


def findings(rows: list[Row]) -> list[Finding]:
    found = [Finding("idle", row.middleware, "", _percent(row.idle), row.idle <= IDLE, value=row.idle) for row in rows]
    for row in rows:
        if row.failure:
            found.append(failed("busy", row.middleware))
        elif row.both is not None:
            found.append(Finding("busy", row.middleware, "", _percent(row.both), row.both <= BUSY, value=row.both))
    return found


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{share:.2f} %"
