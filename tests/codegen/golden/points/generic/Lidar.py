# Generated from Lidar.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module Lidar: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import (
    FLOAT32,
    INT32,
    INT64,
    Enumeration,
    Field,
    Future,
    Interface,
    Operation,
    Pattern,
    Proxy,
    Sequence,
    Struct,
    dtype_of,
)


class Kind(IntEnum):
    """Kind of module Lidar."""

    ground = 0
    wall = 1

    __contract__: ClassVar[Enumeration]


Kind.__contract__ = Enumeration(
    "Lidar::Kind",
    (
        ("ground", 0),
        ("wall", 1),
    ),
    Kind,
)


@dataclass(slots=True)
class Point:
    """One echo."""

    x: float = 0.0  # m
    y: float = 0.0  # m
    z: float = 0.0  # m
    intensity: int = 0
    kind: Kind = Kind.ground

    __contract__: ClassVar[Struct]


Point.__contract__ = Struct(
    "Lidar::Point",
    (
        Field("x", FLOAT32, doc="m"),
        Field("y", FLOAT32, doc="m"),
        Field("z", FLOAT32, doc="m"),
        Field("intensity", INT32),
        Field("kind", Kind.__contract__),
    ),
    Point,
    doc="One echo.",
)

Points: TypeAlias = NDArray[np.void]


@dataclass(slots=True)
class Scan:
    """Scan of module Lidar."""

    stamp: int = 0  # ns
    points: NDArray[np.void] = field(
        default_factory=lambda: np.empty(0, dtype_of(Point)),
    )

    __contract__: ClassVar[Struct]


Scan.__contract__ = Struct(
    "Lidar::Scan",
    (
        Field("stamp", INT64, doc="ns"),
        Field("points", Sequence(Point.__contract__, records=True)),
    ),
    Scan,
)

_Lidar_filtered: Operation[tuple[Points, NDArray[np.void]]] = Operation(
    "Lidar::Lidar",
    "filtered",
    inputs=(Field("points", Sequence(Point.__contract__, records=True)),),
    outputs=(
        Field("ret", Sequence(Point.__contract__, records=True)),
        Field("rest", Sequence(Point.__contract__, records=True)),
    ),
    pattern=Pattern.QUERY,
)
LIDAR_INTERFACE = Interface(
    "Lidar::Lidar",
    (_Lidar_filtered,),
)

_LidarPub_scanned: Operation[None] = Operation(
    "Lidar::LidarPub",
    "scanned",
    inputs=(Field("scan", Scan.__contract__),),
    pattern=Pattern.PUBLISH,
)
LIDARPUB_INTERFACE = Interface(
    "Lidar::LidarPub",
    (_LidarPub_scanned,),
)


class LidarProxy(Proxy):
    """Calls Lidar of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = LIDAR_INTERFACE

    def filtered(
        self,
        points: Points | list[Point],
        *,
        deadline: float | None = None,
    ) -> tuple[Points, NDArray[np.void]]:
        """`filtered` of Lidar.Lidar.

        IDSL: [query] Points filtered(Points points, out [records] sequence<Point> rest)
        """
        return self._ask(_Lidar_filtered, (points,), deadline)

    def filteredAsync(
        self,
        points: Points | list[Point],
        *,
        deadline: float | None = None,
    ) -> Future[tuple[Points, NDArray[np.void]]]:
        """Call `filtered` without waiting. The Future is done within the deadline."""
        return self._ask_async(_Lidar_filtered, (points,), deadline)


class LidarPubPublisher(Proxy):
    """Publishes LidarPub. A call waits only if its QoS is reliable."""

    interface = LIDARPUB_INTERFACE

    def scanned(self, scan: Scan, *, deadline: float | None = None) -> None:
        """`scanned` of Lidar.LidarPub.

        IDSL: [publish] void scanned(Scan scan)
        """
        self._send(_LidarPub_scanned, (scan,), deadline)
