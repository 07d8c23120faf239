# Generated from world2d.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of world2d with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake


class DifferentialRobotPubFakes(TypedDict, total=False):
    """Fakes for the peer of `differentialrobotpub`."""

    pushBaseState: Fake[None]


class LaserPubFakes(TypedDict, total=False):
    """Fakes for the peer of `laserpub`."""

    pushLaserData: Fake[None]


class BatteryStatusPubFakes(TypedDict, total=False):
    """Fakes for the peer of `batterystatuspub`."""

    pushBatteryState: Fake[None]


class Fakes(TypedDict, total=False):
    """Fakes for the peers of all ports."""

    differentialrobotpub: DifferentialRobotPubFakes
    laserpub: LaserPubFakes
    batterystatuspub: BatteryStatusPubFakes
