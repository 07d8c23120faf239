"""The code of points.

This file is yours: rcgen wrote it once and never changes it again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import dtype_of

from .generic import Lidar
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """Only one method runs at a time. While it waits for the reply of another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when all required components are visible."""
        # Proxies: self.lidar_proxy, self.lidarpub_proxy

    def compute(self) -> None:
        """Called every 100 ms."""

    def Lidar_filtered(
        self,
        points: Lidar.Points,
    ) -> tuple[Lidar.Points, NDArray[np.void]]:
        """`filtered` of Lidar.Lidar.

        IDSL: [query] Points filtered(Points points, out [records] sequence<Point> rest)
        """
        return np.empty(0, dtype_of(Lidar.Point)), np.empty(0, dtype_of(Lidar.Point))
