# Generated from BatteryStatusPub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompBatteryStatusPub: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import Field, Interface, Operation

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
