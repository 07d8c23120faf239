"""The code of ship.

This file is yours: rcgen wrote it once and never changes it again.
"""

from __future__ import annotations

from collections.abc import Generator

from robocomp_py.actions.api import ServerGoal

from .generic import RoboCompVoyage
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """Only one method runs at a time. While it waits for the reply of another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when all required components are visible."""
        # Proxies: self.pilot_proxy, self.captain_proxy

    def compute(self) -> None:
        """Called every 20 ms."""

    def Captain_battery(self) -> float:
        """`battery` of RoboCompVoyage.Captain.

        IDSL: [query] float battery()
        """
        return 0.0

    def Captain_goTo(
        self,
        goal: RoboCompVoyage.PilotGoToGoal,
        target: RoboCompVoyage.Place,
        speed: float,
    ) -> Generator[None, None, RoboCompVoyage.Arrival]:
        """Go to a place.

        IDSL: [action] Arrival goTo(Place target, float speed = 0.5) feedback(float
        left, Places seen) throws Blocked

        Each `yield` waits for the next `compute`, and raises Cancelled if the goal is
        cancelled.
        """
        yield
        return RoboCompVoyage.Arrival()

    def Captain_dock(self, goal: ServerGoal) -> Generator[None]:
        """`dock` of RoboCompVoyage.Captain.

        IDSL: [action] void dock()

        Each `yield` waits for the next `compute`, and raises Cancelled if the goal is
        cancelled.
        """
        yield

    def Captain_turn_round(
        self,
        goal: RoboCompVoyage.CaptainTurnRoundGoal,
        goals: int,
    ) -> Generator[None, None, tuple[bool, float]]:
        """`turn_round` of RoboCompVoyage.Captain.

        IDSL: [action] bool turn_round(int goals, out float list) feedback(int deadline)

        Each `yield` waits for the next `compute`, and raises Cancelled if the goal is
        cancelled.
        """
        yield
        return False, 0.0
