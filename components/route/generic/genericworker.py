# Generated from route.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of route, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from robocomp_py.runtime.api import Component, Port, Verb, Worker

from . import RoboCompLaser, RoboCompOmniRobot
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "route",
        ports=(
            Port(
                Verb.REQUIRES,
                RoboCompOmniRobot.OMNIROBOT_INTERFACE,
                proxy=RoboCompOmniRobot.OmniRobotProxy,
            ),
            Port(
                Verb.REQUIRES,
                RoboCompLaser.LASER_INTERFACE,
                proxy=RoboCompLaser.LaserProxy,
            ),
        ),
        params=PARAMS,
        period=0.05,
        description=(
            "Drives a base along a route, also sideways, and waits while "
            "something is in its way."
        ),
    )
    middleware = "auto"

    omnirobot_proxy: RoboCompOmniRobot.OmniRobotProxy
    laser_proxy: RoboCompLaser.LaserProxy
