# Generated from wander.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of wander with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake

from . import RoboCompGenericBase, RoboCompLaser


class LaserFakes(TypedDict, total=False):
    """Fakes for the peer of `laser`."""

    getLaserData: Fake[RoboCompLaser.TLaserData]
    getLaserAndBStateData: Fake[
        tuple[RoboCompLaser.TLaserData, RoboCompGenericBase.TBaseState]
    ]
    getLaserConfData: Fake[RoboCompLaser.LaserConfData]


class DifferentialRobotFakes(TypedDict, total=False):
    """Fakes for the peer of `differentialrobot`."""

    getBaseState: Fake[RoboCompGenericBase.TBaseState]
    getBasePose: Fake[tuple[int, int, float]]
    setSpeedBase: Fake[None]
    stopBase: Fake[None]
    resetOdometer: Fake[None]
    setOdometer: Fake[None]
    setOdometerPose: Fake[None]
    correctOdometer: Fake[None]


class Fakes(TypedDict, total=False):
    """Fakes for the peers of all ports."""

    laser: LaserFakes
    differentialrobot: DifferentialRobotFakes
