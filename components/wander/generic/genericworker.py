# Generated from wander.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of wander, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

from robocomp_py.runtime.api import Component, Port, QoS, Verb, Worker

from . import (
    RoboCompDifferentialRobot,
    RoboCompGotoPoint,
    RoboCompLaser,
    RoboCompLaserPub,
)
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "wander",
        ports=(
            Port(
                Verb.REQUIRES,
                RoboCompLaser.LASER_INTERFACE,
                proxy=RoboCompLaser.LaserProxy,
            ),
            Port(
                Verb.REQUIRES,
                RoboCompDifferentialRobot.DIFFERENTIALROBOT_INTERFACE,
                proxy=RoboCompDifferentialRobot.DifferentialRobotProxy,
            ),
            Port(
                Verb.SUBSCRIBES,
                RoboCompLaserPub.LASERPUB_INTERFACE,
                qos=QoS(depth=1),
            ),
            Port(Verb.IMPLEMENTS, RoboCompGotoPoint.GOTOPOINT_INTERFACE),
        ),
        params=PARAMS,
        period=0.1,
        description="Drives a robot around, or to a place.",
    )
    middleware = "auto"

    laser_proxy: RoboCompLaser.LaserProxy
    differentialrobot_proxy: RoboCompDifferentialRobot.DifferentialRobotProxy

    @abstractmethod
    def LaserPub_pushLaserData(self, laserData: RoboCompLaser.TLaserData) -> None:
        """A scan, from the first beam to the last.

        IDSL: idempotent void pushLaserData(RoboCompLaser::TLaserData laserData)
        """

    @abstractmethod
    def GotoPoint_go(self, nodo: str, x: float, y: float, alpha: float) -> None:
        """Go to a place: its name, which may be empty, its x and y on the floor in mm,
        and where to look there in rad.

        IDSL: void go(string nodo, float x, float y, float alpha)
        """

    @abstractmethod
    def GotoPoint_turn(self, speed: float) -> None:
        """Turn on the spot: rad/s, positive to the right.

        IDSL: void turn(float speed)
        """

    @abstractmethod
    def GotoPoint_stop(self) -> None:
        """Stand still.

        IDSL: void stop()
        """

    @abstractmethod
    def GotoPoint_atTarget(self) -> bool:
        """Whether the last place to go to was reached.

        IDSL: bool atTarget()
        """
