# Generated from rescue.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of rescue with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake

from . import RoboCompGenericBase


class SpeechFakes(TypedDict, total=False):
    """Fakes for the peer of `speech`."""

    say: Fake[bool]
    isBusy: Fake[bool]


class GotoPointFakes(TypedDict, total=False):
    """Fakes for the peer of `gotopoint`."""

    go: Fake[None]
    turn: Fake[None]
    stop: Fake[None]
    atTarget: Fake[bool]


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

    speech: SpeechFakes
    gotopoint: GotoPointFakes
    differentialrobot: DifferentialRobotFakes
