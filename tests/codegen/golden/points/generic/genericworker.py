# Generated from points.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of points, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import Component, Port, Verb, Worker

from . import Lidar


class GenericWorker(Worker[None]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "points",
        ports=(
            Port(Verb.IMPLEMENTS, Lidar.LIDAR_INTERFACE),
            Port(Verb.REQUIRES, Lidar.LIDAR_INTERFACE, proxy=Lidar.LidarProxy),
            Port(
                Verb.PUBLISHES,
                Lidar.LIDARPUB_INTERFACE,
                proxy=Lidar.LidarPubPublisher,
            ),
        ),
        period=0.1,
    )
    middleware = "auto"

    lidar_proxy: Lidar.LidarProxy
    lidarpub_proxy: Lidar.LidarPubPublisher

    @abstractmethod
    def Lidar_filtered(
        self,
        points: Lidar.Points,
    ) -> tuple[Lidar.Points, NDArray[np.void]]:
        """`filtered` of Lidar.Lidar.

        IDSL: [query] Points filtered(Points points, out [records] sequence<Point> rest)
        """
