# Generated from Laser.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, PYI042, UP040, RUF100
"""Module RoboCompLaser: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import (
    FLOAT32,
    INT32,
    STRING,
    Field,
    Future,
    Interface,
    Operation,
    Proxy,
    Sequence,
    Struct,
)

from . import RoboCompGenericBase

shortVector: TypeAlias = NDArray[np.int32]


@dataclass(slots=True)
class LaserConfData:
    """What a laser is and how it is set."""

    driver: str = ""  # kind of hardware or simulator
    device: str = ""  # where it is connected
    staticConf: int = 0  # 0 if the settings may change while it runs
    maxMeasures: int = 0  # beams in a full turn of the device
    maxDegrees: int = 0  # degrees from the first beam to the last
    maxRange: int = 0  # mm, farthest distance that is measured
    minRange: int = 0  # mm, nearest distance that is measured
    iniRange: int = 0  # degrees, where the measured part begins
    endRange: int = 0  # degrees, where the measured part ends
    cluster: int = 0  # neighbouring beams (0 to 99) taken together as one measure
    sampleRate: int = 0  # ms from one scan to the next
    angleRes: float = 0.0  # degrees from one beam to the next
    angleIni: float = 0.0  # degrees, direction of the first beam

    __contract__: ClassVar[Struct]


LaserConfData.__contract__ = Struct(
    "RoboCompLaser::LaserConfData",
    (
        Field("driver", STRING, doc="kind of hardware or simulator"),
        Field("device", STRING, doc="where it is connected"),
        Field("staticConf", INT32, doc="0 if the settings may change while it runs"),
        Field("maxMeasures", INT32, doc="beams in a full turn of the device"),
        Field("maxDegrees", INT32, doc="degrees from the first beam to the last"),
        Field("maxRange", INT32, doc="mm, farthest distance that is measured"),
        Field("minRange", INT32, doc="mm, nearest distance that is measured"),
        Field("iniRange", INT32, doc="degrees, where the measured part begins"),
        Field("endRange", INT32, doc="degrees, where the measured part ends"),
        Field(
            "cluster",
            INT32,
            doc="neighbouring beams (0 to 99) taken together as one measure",
        ),
        Field("sampleRate", INT32, doc="ms from one scan to the next"),
        Field("angleRes", FLOAT32, doc="degrees from one beam to the next"),
        Field("angleIni", FLOAT32, doc="degrees, direction of the first beam"),
    ),
    LaserConfData,
    doc="What a laser is and how it is set.",
)


@dataclass(slots=True)
class TData:
    """One measure: a direction and how far it is to the first thing there."""

    angle: float = 0.0  # rad from straight ahead, positive to the right
    dist: float = 0.0  # mm

    __contract__: ClassVar[Struct]


TData.__contract__ = Struct(
    "RoboCompLaser::TData",
    (
        Field("angle", FLOAT32, doc="rad from straight ahead, positive to the right"),
        Field("dist", FLOAT32, doc="mm"),
    ),
    TData,
    doc="One measure: a direction and how far it is to the first thing there.",
)

TLaserData: TypeAlias = list[TData]

_Laser_getLaserData: Operation[TLaserData] = Operation(
    "RoboCompLaser::Laser",
    "getLaserData",
    outputs=(Field("ret", Sequence(TData.__contract__)),),
    doc="The last scan.",
)
_Laser_getLaserAndBStateData: Operation[
    tuple[TLaserData, RoboCompGenericBase.TBaseState]
] = Operation(
    "RoboCompLaser::Laser",
    "getLaserAndBStateData",
    outputs=(
        Field("ret", Sequence(TData.__contract__)),
        Field("bState", RoboCompGenericBase.TBaseState.__contract__),
    ),
    doc="The last scan, and where the base was then.",
)
_Laser_getLaserConfData: Operation[LaserConfData] = Operation(
    "RoboCompLaser::Laser",
    "getLaserConfData",
    outputs=(Field("ret", LaserConfData.__contract__),),
    doc="What the laser is and how it is set.",
)
LASER_INTERFACE = Interface(
    "RoboCompLaser::Laser",
    (
        _Laser_getLaserData,
        _Laser_getLaserAndBStateData,
        _Laser_getLaserConfData,
    ),
)


class LaserProxy(Proxy):
    """Calls Laser of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = LASER_INTERFACE

    def getLaserData(self, *, deadline: float | None = None) -> TLaserData:
        """The last scan.

        IDSL: TLaserData getLaserData()
        """
        return self._ask(_Laser_getLaserData, (), deadline)

    def getLaserDataAsync(self, *, deadline: float | None = None) -> Future[TLaserData]:
        """Call `getLaserData` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_Laser_getLaserData, (), deadline)

    def getLaserAndBStateData(
        self,
        *,
        deadline: float | None = None,
    ) -> tuple[TLaserData, RoboCompGenericBase.TBaseState]:
        """The last scan, and where the base was then.

        IDSL: TLaserData getLaserAndBStateData(out RoboCompGenericBase::TBaseState
        bState)
        """
        return self._ask(_Laser_getLaserAndBStateData, (), deadline)

    def getLaserAndBStateDataAsync(
        self,
        *,
        deadline: float | None = None,
    ) -> Future[tuple[TLaserData, RoboCompGenericBase.TBaseState]]:
        """Call `getLaserAndBStateData` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_Laser_getLaserAndBStateData, (), deadline)

    def getLaserConfData(self, *, deadline: float | None = None) -> LaserConfData:
        """What the laser is and how it is set.

        IDSL: LaserConfData getLaserConfData()
        """
        return self._ask(_Laser_getLaserConfData, (), deadline)

    def getLaserConfDataAsync(
        self,
        *,
        deadline: float | None = None,
    ) -> Future[LaserConfData]:
        """Call `getLaserConfData` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_Laser_getLaserConfData, (), deadline)
