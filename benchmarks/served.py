"""Measures a component that simulates a scene, and one that hears its cameras and lasers over shared memory.

A picture carries the time at which it was filled, in its first bytes. The component begins to draw when the first
picture is wanted, so the first picture tells when it is ready with its renderer.
"""

from __future__ import annotations

import contextlib
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from robocomp_py.cli.rc import main as rc

from .components import Ready, component
from .pair import place
from .parties import PATIENCE
from .process import ROOT, cpu_seconds
from .scenes import hall

RAYS, WIDTH, HEIGHT = 1080, 640, 480
HERTZ = 20

_SETTLED = 2.0
"""Seconds after the first picture from which on is measured."""

_SPECIFIC = """\
import struct
import time

from robocomp_py.sim.serve import studio
from robocomp_py.sim.serve.simulator import Simulator

from .generic.genericworker import GenericWorker


class Stamped(studio.Renderer):
    def draw(self, view, camera, colours, depths):
        super().draw(view, camera, colours, depths)
        struct.pack_into("<d", colours, 0, time.perf_counter())


studio.Renderer = Stamped


class SpecificWorker(Simulator, GenericWorker):
    pass
"""

_CDSL = """\
import "CameraRGBDSimplePub.idsl";
import "LaserPub.idsl";

Component watcher
{
    Communications { subscribesTo CameraRGBDSimplePub, LaserPub; };
    language python;
};
"""

_WATCHER = """\
import json
import os
import pathlib
import struct
import time

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def initialize(self):
        self.pictures, self.scans = [], []

    def compute(self):
        pass

    def CameraRGBDSimplePub_pushRGBD(self, im, dep):
        now = time.perf_counter()
        (filled,) = struct.unpack_from("<d", im.image)
        if not self.pictures:
            pathlib.Path(os.environ["FIRST"]).write_text(str(now))
        self.pictures.append((now, now - filled))

    def LaserPub_pushLaserData(self, laserData):
        self.scans.append(time.perf_counter())

    def finish(self):
        pathlib.Path(os.environ["HEARD"]).write_text(json.dumps([self.pictures, self.scans]))
"""


@dataclass(frozen=True)
class Served:
    first: float
    """Seconds from the start of the process to the first picture that is heard."""
    pictures: float
    """Of one camera, in a second."""
    scans: float
    """Of one laser, in a second."""
    share: float
    """Of a core, that the simulating component takes; %."""
    delay: float
    """Seconds from a filled picture to its handler; the median."""


@contextlib.contextmanager
def house(shapes: int, *, rays: int = 360, cameras: bool = False) -> Iterator[Path]:
    """A folder with the component `house`, which simulates a scene of two robots with lasers; and `watcher`."""
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as name:
        folder, tree = Path(name), hall(shapes)
        for robot in ("robot0", "robot1"):
            tree.set_value(f"{robot}_laser", "measures", RAYS if cameras else rays)
        for robot in ("robot0", "robot1") if cameras else ():
            tree.add(f"{robot}_mount", "rgbd", f"{robot}_eye", width=WIDTH, height=HEIGHT, focal=500)
        tree.save(folder / "hall.xml")
        with contextlib.redirect_stdout(sys.stderr):
            if rc(["sim", "new", str(folder / "hall.xml"), "-o", str(folder / "house")]) != 0:
                raise RuntimeError("the component could not be made")
        if cameras:
            (folder / "house/specificworker.py").write_text(_SPECIFIC, encoding="utf-8")
            (folder / "watcher.cdsl").write_text(_CDSL, encoding="utf-8")
            command = [sys.executable, "-m", "robocomp_py.cli.rcgen", str(folder / "watcher.cdsl")]
            command += ["-o", str(folder / "watcher")]
            subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
            (folder / "watcher/specificworker.py").write_text(_WATCHER, encoding="utf-8")
        yield folder


def served(folder: Path, seconds: float) -> Served:
    """Run both for some seconds."""
    first, heard = folder / "first", folder / "heard"
    first.unlink(missing_ok=True)
    period = ("component.period=" + str(1 / HERTZ), "params.physics=true")
    with contextlib.ExitStack() as undo:
        here = undo.enter_context(place())
        undo.enter_context(component("watcher", folder, "shm", runtime=here.folder, FIRST=str(first), HEARD=str(heard)))
        begun = time.perf_counter()
        ready = undo.enter_context(component("house", folder, "shm", *period, runtime=here.folder))
        reached = _awaited(first) - begun
        time.sleep(_SETTLED)
        begin, share = _watched(ready, seconds)
    end = begin + seconds
    pictures, scans = json.loads(heard.read_text(encoding="utf-8"))
    within = [delay for now, delay in pictures if begin <= now < end]
    scanned = sum(begin <= now < end for now in scans)
    return Served(reached, len(within) / 2 / seconds, scanned / 2 / seconds, share, statistics.median(within))


def _awaited(first: Path) -> float:
    """The time of the first picture."""
    limit = time.monotonic() + 3 * PATIENCE
    while time.monotonic() < limit:
        with contextlib.suppress(FileNotFoundError, ValueError):  # not yet written, or not yet whole
            return float(first.read_text(encoding="utf-8"))
        time.sleep(0.01)
    raise TimeoutError("no picture was published")


def _watched(ready: Ready, seconds: float) -> tuple[float, float]:
    """When the watch began, and the share of a core that a component took during it, %."""
    begun, before = time.perf_counter(), cpu_seconds(ready.pid)
    time.sleep(seconds)
    passed, after = time.perf_counter() - begun, cpu_seconds(ready.pid)
    return begun, (after - before) / passed * 100
