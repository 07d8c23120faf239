# Generated from world2d.cdsl by rcgen 0.1.0: edits are lost.
"""What a test of world2d may fake, for ComponentTest: by port, then by operation."""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake


class DifferentialRobotPubFakes(TypedDict, total=False):
    """What the other side of `differentialrobotpub` does."""

    pushBaseState: Fake[None]


class LaserPubFakes(TypedDict, total=False):
    """What the other side of `laserpub` does."""

    pushLaserData: Fake[None]


class BatteryStatusPubFakes(TypedDict, total=False):
    """What the other side of `batterystatuspub` does."""

    pushBatteryState: Fake[None]


class Fakes(TypedDict, total=False):
    """The other sides of all ports."""

    differentialrobotpub: DifferentialRobotPubFakes
    laserpub: LaserPubFakes
    batterystatuspub: BatteryStatusPubFakes
