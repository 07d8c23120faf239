"""A component with an action, which runs in this process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from robocomp_py.cli import rcgen
from robocomp_py.runtime.load import load_worker
from robocomp_py.transports.base import find_transport

from ..runtime.running import make, running

IDSL = """
module RoboCompPilot
{
    struct Place { float x; float y; };   // in m
    exception Blocked { string by; };
    interface Pilot
    {
        // Fly straight to a place.
        [action] int fly(Place target, int steps) feedback(int left) throws Blocked;
    };
};
"""
CDSL = 'import "Pilot.idsl"; Component pilot { language python; period 10 ms; Communications { implements Pilot; }; };'
CODE = """
from .generic import RoboCompPilot
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def Pilot_fly(self, goal, target, steps):
        if target.x < 0:
            raise RoboCompPilot.Blocked("a bird")
        for number in range(steps):
            goal.feedback(left=steps - number)
            yield
        return steps
"""


@contextmanager
def flying(folder: Path) -> Iterator[None]:
    """While entered, `pilot` runs; its files are made in `folder`."""
    component = folder / "pilot"
    component.mkdir()
    (component / "Pilot.idsl").write_text(IDSL)
    (component / "pilot.cdsl").write_text(CDSL)
    assert rcgen.main([str(component / "pilot.cdsl")]) == 0
    (component / "specificworker.py").write_text(CODE)
    with running(make(load_worker(component), find_transport, "middleware=shm", name="pilot")):
        yield
