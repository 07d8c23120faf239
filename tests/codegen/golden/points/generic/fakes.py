# Generated from points.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of points with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

from typing import TypedDict

import numpy as np
from numpy.typing import NDArray
from robocomp_py.testing.fakes import Fake

from . import Lidar


class LidarFakes(TypedDict, total=False):
    """Fakes for the peer of `lidar`."""

    filtered: Fake[tuple[Lidar.Points, NDArray[np.void]]]


class LidarPubFakes(TypedDict, total=False):
    """Fakes for the peer of `lidarpub`."""

    scanned: Fake[None]


class Fakes(TypedDict, total=False):
    """Fakes for the peers of all ports."""

    lidar: LidarFakes
    lidarpub: LidarPubFakes
