# Generated from cell.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of cell with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake


class SimulationPubFakes(TypedDict, total=False):
    """Fakes for the peer of `simulationpub`."""

    advanced: Fake[None]


class Fakes(TypedDict, total=False):
    """Fakes for the peers of all ports."""

    simulationpub: SimulationPubFakes
