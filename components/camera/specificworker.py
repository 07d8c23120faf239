"""A camera on the robot's head: draws what would be seen from where the robot is.

Yours: rcgen wrote this file once and never touches it again.
"""

from __future__ import annotations

from .generic import RoboCompCameraSimple, RoboCompGenericBase
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """No two methods here ever run at once. While one waits for an answer from another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when the components required are there."""
        # Proxies: self.camerasimplepub_proxy

    def compute(self) -> None:
        """Called every 100 ms."""

    def DifferentialRobotPub_pushBaseState(
        self,
        state: RoboCompGenericBase.TBaseState,
    ) -> None:
        """Where the base is and how it moves.

        IDSL: void pushBaseState(RoboCompGenericBase::TBaseState state)
        """

    def CameraSimple_getImage(self) -> RoboCompCameraSimple.TImage:
        """The newest picture.

        IDSL: TImage getImage() throws HardwareFailedException
        """
        return RoboCompCameraSimple.TImage()
