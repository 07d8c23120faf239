# Generated from route.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of route with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake

from . import RoboCompGenericBase, RoboCompLaser


class OmniRobotFakes(TypedDict, total=False):
    """Fakes for the peer of `omnirobot`."""

    getBaseState: Fake[RoboCompGenericBase.TBaseState]
    getBasePose: Fake[tuple[int, int, float]]
    setSpeedBase: Fake[None]
    stopBase: Fake[None]
    resetOdometer: Fake[None]
    setOdometer: Fake[None]
    setOdometerPose: Fake[None]
    correctOdometer: Fake[None]


class LaserFakes(TypedDict, total=False):
    """Fakes for the peer of `laser`."""

    getLaserData: Fake[RoboCompLaser.TLaserData]
    getLaserAndBStateData: Fake[
        tuple[RoboCompLaser.TLaserData, RoboCompGenericBase.TBaseState]
    ]
    getLaserConfData: Fake[RoboCompLaser.LaserConfData]


class Fakes(TypedDict, total=False):
    """Fakes for the peers of all ports."""

    omnirobot: OmniRobotFakes
    laser: LaserFakes
