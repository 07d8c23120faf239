"""The mission: find who needs help, call for help, and do not run out of battery.

Yours: rcgen wrote this file once and never touches it again.
"""

from __future__ import annotations

from .generic import RoboCompBatteryStatus, RoboCompCameraSimple, RoboCompGenericBase
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """No two methods here ever run at once. While one waits for an answer from another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when the components required are there."""
        # Proxies: self.speech_proxy, self.gotopoint_proxy, self.differentialrobot_proxy

    def compute(self) -> None:
        """Called every 100 ms."""

    def CameraSimplePub_pushImage(self, image: RoboCompCameraSimple.TImage) -> None:
        """A picture, as soon as it is taken.

        IDSL: void pushImage(RoboCompCameraSimple::TImage image)
        """

    def BatteryStatusPub_pushBatteryState(
        self,
        battery: RoboCompBatteryStatus.TBattery,
    ) -> None:
        """What is left now.

        IDSL: void pushBatteryState(RoboCompBatteryStatus::TBattery battery)
        """

    def DifferentialRobotPub_pushBaseState(
        self,
        state: RoboCompGenericBase.TBaseState,
    ) -> None:
        """Where the base is and how it moves.

        IDSL: void pushBaseState(RoboCompGenericBase::TBaseState state)
        """
