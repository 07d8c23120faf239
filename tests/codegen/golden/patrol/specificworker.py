"""The code of patrol.

This file is yours: rcgen wrote it once and never changes it again.
"""

from __future__ import annotations

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """Only one method runs at a time. While it waits for the reply of another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when all required components are visible."""
        # Proxies: self.drawing_proxy

    def compute(self) -> None:
        """Called every 100 ms."""

    def sm_waiting(self) -> None:
        """Called when `waiting` is entered. From here: self.t_waiting_to_working(),
        self.t_waiting_to_off().
        """

    def sm_working(self) -> None:
        """Called when `working` is entered. From here: self.t_working_to_charging(),
        self.t_working_to_broken().
        """

    def sm_moving(self) -> None:
        """Called when `moving` is entered."""

    def sm_driving(self) -> None:
        """Called when `driving` is entered. From here: self.t_driving_to_driving(),
        self.t_driving_to_turning(), self.t_driving_to_arrived().
        """

    def sm_turning(self) -> None:
        """Called when `turning` is entered. From here: self.t_turning_to_charging(),
        self.t_turning_to_driving().
        """

    def sm_arrived(self) -> None:
        """Called when `arrived` is entered, which ends `moving`."""

    def sm_watching(self) -> None:
        """Called when `watching` is entered."""

    def sm_looking(self) -> None:
        """Called when `looking` is entered. From here: self.t_looking_to_looking()."""

    def sm_charging(self) -> None:
        """Called when `charging` is entered. From here:
        self.t_charging_to_waiting().
        """

    def sm_broken(self) -> None:
        """Called when `broken` is entered."""

    def sm_off(self) -> None:
        """Called when `off` is entered, which ends the state machine."""

    def timer_look(self) -> None:
        """Called every 20 ms."""

    def timer_report(self) -> None:
        """Called every 60 s."""
