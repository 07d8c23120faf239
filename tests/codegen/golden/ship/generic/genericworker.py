# Generated from ship.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of ship, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Generator

from robocomp_py.actions.api import ServerGoal
from robocomp_py.runtime.api import Component, Port, Verb, Worker

from . import RoboCompVoyage


class GenericWorker(Worker[None]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "ship",
        ports=(
            Port(
                Verb.IMPLEMENTS,
                RoboCompVoyage.CAPTAIN_INTERFACE,
                policies=(
                    ("goTo", "preempt"),
                    ("dock", "queue"),
                ),
            ),
            Port(
                Verb.REQUIRES,
                RoboCompVoyage.PILOT_INTERFACE,
                proxy=RoboCompVoyage.PilotProxy,
            ),
            Port(
                Verb.REQUIRES,
                RoboCompVoyage.CAPTAIN_INTERFACE,
                proxy=RoboCompVoyage.CaptainProxy,
            ),
        ),
        period=0.02,
    )
    middleware = "auto"

    pilot_proxy: RoboCompVoyage.PilotProxy
    captain_proxy: RoboCompVoyage.CaptainProxy

    @abstractmethod
    def Captain_battery(self) -> float:
        """`battery` of RoboCompVoyage.Captain.

        IDSL: [query] float battery()
        """

    @abstractmethod
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

    @abstractmethod
    def Captain_dock(self, goal: ServerGoal) -> Generator[None]:
        """`dock` of RoboCompVoyage.Captain.

        IDSL: [action] void dock()

        Each `yield` waits for the next `compute`, and raises Cancelled if the goal is
        cancelled.
        """

    @abstractmethod
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
