# Generated from ship.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of ship with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake

from . import RoboCompVoyage


class PilotFakes(TypedDict, total=False):
    """Fakes for the peer of `pilot`."""

    battery: Fake[float]
    goTo: Fake[RoboCompVoyage.Arrival]
    dock: Fake[None]


class CaptainFakes(TypedDict, total=False):
    """Fakes for the peer of `captain`."""

    battery: Fake[float]
    goTo: Fake[RoboCompVoyage.Arrival]
    dock: Fake[None]
    turn_round: Fake[tuple[bool, float]]


class Fakes(TypedDict, total=False):
    """Fakes for the peers of all ports."""

    pilot: PilotFakes
    captain: CaptainFakes
