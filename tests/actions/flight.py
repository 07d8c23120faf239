"""A ship that executes goals, and a crew that awaits them in asyncio code, as components in a folder."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.cli import rcgen

IDSL = """
module RoboCompPilot
{
    exception Blocked { string by; };
    interface Pilot { [action] int fly(int steps) feedback(int left) throws Blocked; };
};
"""
SHIP = (
    'import "../Pilot.idsl"; Component ship { language python; period 10 ms; Communications { implements Pilot; }; };'
)
CREW = 'import "../Pilot.idsl"; Component crew { language python; period 10 ms; Communications { requires Pilot; }; };'
SHIP_CODE = """
from .generic import RoboCompPilot
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def Pilot_fly(self, goal, steps):
        if steps < 0:
            raise RoboCompPilot.Blocked("a bird")
        for number in range(steps):
            goal.feedback(left=steps - number)
            yield
        return steps
"""
CREW_CODE = """
import asyncio

from robocomp_py.errors import Cancelled

from .generic.genericworker import GenericWorker
from .generic.RoboCompPilot import Blocked


class SpecificWorker(GenericWorker):
    def compute(self):
        asyncio.run(self.fly())
        self.stop()

    async def fly(self):
        self.log.info("flown: %d", await self.pilot_proxy.fly(3))
        try:
            await self.pilot_proxy.fly(-1)
        except Blocked as blocked:
            self.log.info("blocked by %s", blocked.by)
        goal = self.pilot_proxy.fly(100_000)
        try:
            await asyncio.wait_for(goal, 0.05)
        except TimeoutError:
            goal.cancel()
        try:
            await goal
        except Cancelled:
            self.log.info("cancelled: %s", goal.status.name)
"""
TOLD = ("flown: 3", "blocked by a bird", "cancelled: CANCELED")
"""What the crew logs before it stops."""


def write(folder: Path) -> None:
    """Write and generate the components `ship` and `crew`."""
    (folder / "Pilot.idsl").write_text(IDSL)
    for name, text, code in (("ship", SHIP, SHIP_CODE), ("crew", CREW, CREW_CODE)):
        (folder / name).mkdir()
        (folder / name / f"{name}.cdsl").write_text(text)
        assert rcgen.main([str(folder / name / f"{name}.cdsl")]) == 0
        (folder / name / "specificworker.py").write_text(code)
