"""Drives a robot around, or to a place, and past whatever is in the way.

Yours: rcgen wrote this file once and never touches it again.
"""

from __future__ import annotations

from .generic import RoboCompLaser
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """No two methods here ever run at once. While one waits for an answer from another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when the components required are there."""
        # Proxies: self.laser_proxy, self.differentialrobot_proxy

    def compute(self) -> None:
        """Called every 100 ms."""

    def LaserPub_pushLaserData(self, laserData: RoboCompLaser.TLaserData) -> None:
        """A scan, from the first beam to the last.

        IDSL: idempotent void pushLaserData(RoboCompLaser::TLaserData laserData)
        """

    def GotoPoint_go(self, nodo: str, x: float, y: float, alpha: float) -> None:
        """Go to a place: its name, which may be empty, its x and y on the floor in mm,
        and the heading to take there in rad.

        IDSL: void go(string nodo, float x, float y, float alpha)
        """

    def GotoPoint_turn(self, speed: float) -> None:
        """Turn on the spot: rad/s, positive to the right.

        IDSL: void turn(float speed)
        """

    def GotoPoint_stop(self) -> None:
        """Stand still.

        IDSL: void stop()
        """

    def GotoPoint_atTarget(self) -> bool:
        """Whether the last place to go to was reached.

        IDSL: bool atTarget()
        """
        return False
