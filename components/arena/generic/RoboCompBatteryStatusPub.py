# Generated from BatteryStatusPub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompBatteryStatusPub: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import Field, Interface, Operation, Proxy

from . import RoboCompBatteryStatus

_BatteryStatusPub_pushBatteryState: Operation[None] = Operation(
    "RoboCompBatteryStatusPub::BatteryStatusPub",
    "pushBatteryState",
    inputs=(Field("battery", RoboCompBatteryStatus.TBattery.__contract__),),
    doc="What is left now.",
)
BATTERYSTATUSPUB_INTERFACE = Interface(
    "RoboCompBatteryStatusPub::BatteryStatusPub",
    (_BatteryStatusPub_pushBatteryState,),
)


class BatteryStatusPubPublisher(Proxy):
    """Publishes BatteryStatusPub. A call waits only if its QoS is reliable."""

    interface = BATTERYSTATUSPUB_INTERFACE

    def pushBatteryState(
        self,
        battery: RoboCompBatteryStatus.TBattery,
        *,
        deadline: float | None = None,
    ) -> None:
        """What is left now.

        IDSL: void pushBatteryState(RoboCompBatteryStatus::TBattery battery)
        """
        self._send(_BatteryStatusPub_pushBatteryState, (battery,), deadline)
