"""A house with a robot in it, seen from above.

Every compute advances the world's time by `step` seconds, however long it really takes.
With a shorter period everything happens faster, and nothing else changes.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from .generic import RoboCompBatteryStatus, RoboCompGenericBase, RoboCompLaser
from .generic.genericworker import GenericWorker
from .picture import Story, draw
from .robot import Base, Battery, Pose
from .room import Floats, Point, read_room

TBaseState = RoboCompGenericBase.TBaseState
HardwareFailedException = RoboCompGenericBase.HardwareFailedException
TBattery = RoboCompBatteryStatus.TBattery
BatteryStates = RoboCompBatteryStatus.BatteryStates

FIELD_DEG = 270
REACH_M = 5.0
CHARGER_M = 0.5


class SpecificWorker(GenericWorker):
    """Uses metres inside; messages are in millimetres, as in RoboComp."""

    def initialize(self) -> None:
        """Put the robot at its place in the map."""
        self.room = read_room(Path(__file__).parent / self.params.map)
        self.base = Base(self.room, self.params.max_adv, self.params.max_rot)
        self.battery = Battery(self.params.battery, self.params.capacity)
        half = math.radians(FIELD_DEG / 2)
        self.directions = np.linspace(-half, half, self.params.beams)
        self.random = np.random.default_rng(self.params.seed)
        self.distances = self.measured()
        self.story = Story()

    def compute(self) -> None:
        """Simulate one step, and publish the result."""
        self.live(self.params.step)
        self.laserpub_proxy.pushLaserData(self.scan())
        self.differentialrobotpub_proxy.pushBaseState(self.base_state())
        self.batterystatuspub_proxy.pushBatteryState(self.battery_state())

    def finish(self) -> None:
        """Draw the story, if a picture is configured."""
        if self.params.picture:
            path = Path(self.params.picture).resolve()
            path.write_text(draw(self.room, self.story), encoding="utf-8")
            self.log.info("what happened is drawn in %s", path)

    def live(self, seconds: float) -> None:
        """Drive, drain the battery, and measure."""
        if self.battery.empty:
            self.base.command(0.0, 0.0)
        driven, turned = self.base.step(seconds)
        at_charger = math.dist(self.base.pose.place, self.room.charger) < CHARGER_M
        self.battery.step(seconds, driven, turned, charging=at_charger)
        self.distances = self.measured()
        if self.params.picture:
            pose, percent = self.base.pose, self.battery.percent
            self.story.note(seconds, pose, percent, self.beam_ends())

    def measured(self) -> Floats:
        """The distances in m that the laser measures."""
        pose = self.base.pose
        exact = self.room.distances(pose.place, pose.heading + self.directions, REACH_M)
        noise = self.random.normal(0.0, self.params.noise / 1000, exact.size)
        return np.clip(exact + noise, 0.0, REACH_M)

    def beam_ends(self) -> list[Point]:
        """The places that the laser has hit."""
        beams = zip(self.distances, self.directions, strict=True)
        return [self.base.pose.ahead(distance, aside) for distance, aside in beams]

    # Published data.

    def scan(self) -> RoboCompLaser.TLaserData:
        """The last scan."""
        angles, distances = self.directions.tolist(), (self.distances * 1000).tolist()
        return list(map(RoboCompLaser.TData, angles, distances))

    def base_state(self) -> TBaseState:
        """The pose by odometry, and the corrected one."""
        raw, best = self.base.odometer, self.base.best
        return TBaseState(
            x=raw.x * 1000,
            z=raw.z * 1000,
            alpha=raw.heading,
            correctedX=best.x * 1000,
            correctedZ=best.z * 1000,
            correctedAlpha=best.heading,
            advVz=self.base.adv * 1000,
            rotV=self.base.rot,
            isMoving=self.base.moving,
        )

    def battery_state(self) -> TBattery:
        """The state of the battery."""
        at_charger = (
            BatteryStates.Charged if self.battery.full else BatteryStates.Charging
        )
        return TBattery(
            percentage=self.battery.percent,
            state=at_charger if self.battery.charging else BatteryStates.Disconnected,
            voltage=self.battery.voltage,
            current=self.battery.power / self.battery.voltage,
            timeToGo=self.battery.seconds_to_go,
            power=self.battery.power,
            consumptionPerHour=max(0.0, -self.battery.power),
        )

    # Handlers.

    def DifferentialRobot_setSpeedBase(self, adv: float, rot: float) -> None:
        """Drive with these speeds, for a second of world time at most."""
        try:
            self.base.command(adv / 1000, rot)
        except ValueError as wrong:
            raise HardwareFailedException(str(wrong)) from wrong

    def DifferentialRobot_stopBase(self) -> None:
        self.base.command(0.0, 0.0)

    def DifferentialRobot_getBaseState(self) -> TBaseState:
        return self.base_state()

    def DifferentialRobot_getBasePose(self) -> tuple[int, int, float]:
        raw = self.base.odometer
        return round(raw.x * 1000), round(raw.z * 1000), raw.heading

    def DifferentialRobot_resetOdometer(self) -> None:
        self.base.odometer = self.base.best = Pose(0.0, 0.0, 0.0)

    def DifferentialRobot_setOdometer(self, state: TBaseState) -> None:
        raw = pose_of(state.x, state.z, state.alpha)
        best = pose_of(state.correctedX, state.correctedZ, state.correctedAlpha)
        self.base.odometer, self.base.best = raw, best

    def DifferentialRobot_setOdometerPose(self, x: int, z: int, alpha: float) -> None:
        self.base.odometer = self.base.best = pose_of(x, z, alpha)

    def DifferentialRobot_correctOdometer(self, x: int, z: int, alpha: float) -> None:
        self.base.best = pose_of(x, z, alpha)

    def Laser_getLaserData(self) -> RoboCompLaser.TLaserData:
        return self.scan()

    def Laser_getLaserAndBStateData(
        self,
    ) -> tuple[RoboCompLaser.TLaserData, TBaseState]:
        return self.scan(), self.base_state()

    def Laser_getLaserConfData(self) -> RoboCompLaser.LaserConfData:
        """The configuration of the laser."""
        return RoboCompLaser.LaserConfData(
            driver="world2d",
            device=self.params.map,
            staticConf=1,
            maxMeasures=self.params.beams,
            maxDegrees=FIELD_DEG,
            maxRange=round(REACH_M * 1000),
            endRange=FIELD_DEG,
            sampleRate=round(self.params.step * 1000),
            angleRes=FIELD_DEG / (self.params.beams - 1),
            angleIni=-FIELD_DEG / 2,
        )

    def BatteryStatus_getBatteryState(self) -> TBattery:
        return self.battery_state()


def pose_of(x: float, z: float, alpha: float) -> Pose:
    """A pose from mm and rad. HardwareFailedException if there is no such pose."""
    pose = Pose(x / 1000, z / 1000, alpha)
    if not pose.is_possible:
        raise HardwareFailedException(f"{x:g}, {z:g}, {alpha:g} is not a pose")
    return pose
