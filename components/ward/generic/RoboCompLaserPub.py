# Generated from LaserPub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompLaserPub: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import Field, Interface, Operation, Proxy, Sequence

from . import RoboCompLaser

_LaserPub_pushLaserData: Operation[None] = Operation(
    "RoboCompLaserPub::LaserPub",
    "pushLaserData",
    inputs=(Field("laserData", Sequence(RoboCompLaser.TData.__contract__)),),
    idempotent=True,
    doc="A scan, from the first beam to the last.",
)
LASERPUB_INTERFACE = Interface(
    "RoboCompLaserPub::LaserPub",
    (_LaserPub_pushLaserData,),
)


class LaserPubPublisher(Proxy):
    """Publishes LaserPub. A call waits only if its QoS is reliable."""

    interface = LASERPUB_INTERFACE

    def pushLaserData(
        self,
        laserData: RoboCompLaser.TLaserData,
        *,
        deadline: float | None = None,
    ) -> None:
        """A scan, from the first beam to the last.

        IDSL: idempotent void pushLaserData(RoboCompLaser::TLaserData laserData)
        """
        self._send(_LaserPub_pushLaserData, (laserData,), deadline)
