# Generated from world2d.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of world2d, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

from robocomp_py.runtime.api import Component, Port, QoS, Verb, Worker

from . import (
    RoboCompBatteryStatus,
    RoboCompBatteryStatusPub,
    RoboCompDifferentialRobot,
    RoboCompDifferentialRobotPub,
    RoboCompGenericBase,
    RoboCompLaser,
    RoboCompLaserPub,
)
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "world2d",
        ports=(
            Port(
                Verb.IMPLEMENTS,
                RoboCompDifferentialRobot.DIFFERENTIALROBOT_INTERFACE,
            ),
            Port(Verb.IMPLEMENTS, RoboCompLaser.LASER_INTERFACE),
            Port(Verb.IMPLEMENTS, RoboCompBatteryStatus.BATTERYSTATUS_INTERFACE),
            Port(
                Verb.PUBLISHES,
                RoboCompDifferentialRobotPub.DIFFERENTIALROBOTPUB_INTERFACE,
                proxy=RoboCompDifferentialRobotPub.DifferentialRobotPubPublisher,
            ),
            Port(
                Verb.PUBLISHES,
                RoboCompLaserPub.LASERPUB_INTERFACE,
                qos=QoS(depth=5),
                proxy=RoboCompLaserPub.LaserPubPublisher,
            ),
            Port(
                Verb.PUBLISHES,
                RoboCompBatteryStatusPub.BATTERYSTATUSPUB_INTERFACE,
                proxy=RoboCompBatteryStatusPub.BatteryStatusPubPublisher,
            ),
        ),
        params=PARAMS,
        period=0.05,
        description="A house with a robot in it, seen from above.",
    )
    middleware = "auto"

    differentialrobotpub_proxy: (
        RoboCompDifferentialRobotPub.DifferentialRobotPubPublisher
    )
    laserpub_proxy: RoboCompLaserPub.LaserPubPublisher
    batterystatuspub_proxy: RoboCompBatteryStatusPub.BatteryStatusPubPublisher

    @abstractmethod
    def DifferentialRobot_getBaseState(self) -> RoboCompGenericBase.TBaseState:
        """Where the base is and how it moves.

        IDSL: void getBaseState(out RoboCompGenericBase::TBaseState state) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def DifferentialRobot_getBasePose(self) -> tuple[int, int, float]:
        """Where the base is by its odometer: mm, mm, rad.

        IDSL: void getBasePose(out int x, out int z, out float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def DifferentialRobot_setSpeedBase(self, adv: float, rot: float) -> None:
        """Drive with these speeds from now on: mm/s forwards, rad/s to the right.
        Repeat it while driving: a base may stop when no new speeds arrive for a while.

        IDSL: void setSpeedBase(float adv, float rot) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def DifferentialRobot_stopBase(self) -> None:
        """Stand still.

        IDSL: void stopBase() throws RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def DifferentialRobot_resetOdometer(self) -> None:
        """Call the present pose 0, 0, 0.

        IDSL: void resetOdometer() throws RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def DifferentialRobot_setOdometer(
        self,
        state: RoboCompGenericBase.TBaseState,
    ) -> None:
        """Take pose and best estimate from a state; its speeds do not matter.

        IDSL: void setOdometer(RoboCompGenericBase::TBaseState state) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def DifferentialRobot_setOdometerPose(self, x: int, z: int, alpha: float) -> None:
        """Call the present pose this: mm, mm, rad.

        IDSL: void setOdometerPose(int x, int z, float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def DifferentialRobot_correctOdometer(self, x: int, z: int, alpha: float) -> None:
        """Replace the best estimate, and leave the odometer as it is: mm, mm, rad.

        IDSL: void correctOdometer(int x, int z, float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def Laser_getLaserData(self) -> RoboCompLaser.TLaserData:
        """The last scan.

        IDSL: TLaserData getLaserData()
        """

    @abstractmethod
    def Laser_getLaserAndBStateData(
        self,
    ) -> tuple[RoboCompLaser.TLaserData, RoboCompGenericBase.TBaseState]:
        """The last scan, and where the base was then.

        IDSL: TLaserData getLaserAndBStateData(out RoboCompGenericBase::TBaseState
        bState)
        """

    @abstractmethod
    def Laser_getLaserConfData(self) -> RoboCompLaser.LaserConfData:
        """What the laser is and how it is set.

        IDSL: LaserConfData getLaserConfData()
        """

    @abstractmethod
    def BatteryStatus_getBatteryState(self) -> RoboCompBatteryStatus.TBattery:
        """What is left now.

        IDSL: TBattery getBatteryState() throws HardwareFailedException
        """
