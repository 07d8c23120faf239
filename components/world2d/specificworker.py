"""A robot in a house, seen from above: what it is driven to do, what it measures, what its battery holds.

Yours: rcgen wrote this file once and never touches it again.
"""

from __future__ import annotations

from .generic import RoboCompBatteryStatus, RoboCompGenericBase, RoboCompLaser
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """No two methods here ever run at once. While one waits for an answer from another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when the components required are there."""
        # Proxies: self.differentialrobotpub_proxy, self.laserpub_proxy,
        # self.batterystatuspub_proxy

    def compute(self) -> None:
        """Called every 50 ms."""

    def DifferentialRobot_getBaseState(self) -> RoboCompGenericBase.TBaseState:
        """Where the base is and how it moves.

        IDSL: void getBaseState(out RoboCompGenericBase::TBaseState state) throws
        RoboCompGenericBase::HardwareFailedException
        """
        return RoboCompGenericBase.TBaseState()

    def DifferentialRobot_getBasePose(self) -> tuple[int, int, float]:
        """Where the base is by its odometer: mm, mm, rad.

        IDSL: void getBasePose(out int x, out int z, out float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """
        return 0, 0, 0.0

    def DifferentialRobot_setSpeedBase(self, adv: float, rot: float) -> None:
        """Drive with these speeds from now on: mm/s forwards, rad/s to the right.

        IDSL: void setSpeedBase(float adv, float rot) throws
        RoboCompGenericBase::HardwareFailedException
        """

    def DifferentialRobot_stopBase(self) -> None:
        """Stand still.

        IDSL: void stopBase() throws RoboCompGenericBase::HardwareFailedException
        """

    def DifferentialRobot_resetOdometer(self) -> None:
        """Call the present pose 0, 0, 0.

        IDSL: void resetOdometer() throws RoboCompGenericBase::HardwareFailedException
        """

    def DifferentialRobot_setOdometer(
        self,
        state: RoboCompGenericBase.TBaseState,
    ) -> None:
        """Take pose and best estimate from a state; its speeds do not matter.

        IDSL: void setOdometer(RoboCompGenericBase::TBaseState state) throws
        RoboCompGenericBase::HardwareFailedException
        """

    def DifferentialRobot_setOdometerPose(self, x: int, z: int, alpha: float) -> None:
        """Call the present pose this: mm, mm, rad.

        IDSL: void setOdometerPose(int x, int z, float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """

    def DifferentialRobot_correctOdometer(self, x: int, z: int, alpha: float) -> None:
        """Replace the best estimate, and leave the odometer as it is: mm, mm, rad.

        IDSL: void correctOdometer(int x, int z, float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """

    def Laser_getLaserData(self) -> RoboCompLaser.TLaserData:
        """The last scan.

        IDSL: TLaserData getLaserData()
        """
        return []

    def Laser_getLaserAndBStateData(
        self,
    ) -> tuple[RoboCompLaser.TLaserData, RoboCompGenericBase.TBaseState]:
        """The last scan, and where the base was then.

        IDSL: TLaserData getLaserAndBStateData(out RoboCompGenericBase::TBaseState
        bState)
        """
        return [], RoboCompGenericBase.TBaseState()

    def Laser_getLaserConfData(self) -> RoboCompLaser.LaserConfData:
        """What the laser is and how it is set.

        IDSL: LaserConfData getLaserConfData()
        """
        return RoboCompLaser.LaserConfData()

    def BatteryStatus_getBatteryState(self) -> RoboCompBatteryStatus.TBattery:
        """What is left now.

        IDSL: TBattery getBatteryState() throws HardwareFailedException
        """
        return RoboCompBatteryStatus.TBattery()
