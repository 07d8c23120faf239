"""The mission: find a victim before the battery is empty."""

from __future__ import annotations

import math
from collections.abc import Callable

from .generic import RoboCompBatteryStatus, RoboCompCameraSimple, RoboCompGenericBase
from .generic.genericworker import GenericWorker
from .vision import NOTHING, find_red, pixels_of


class SpecificWorker(GenericWorker):
    """`compute` runs the present step, which chooses the next one:

        get ready ▶ explore ▶ call for help ▶ wait until said
                     │   ▲
                     ▼   │
           reach charger ▶ charge

    A step chooses the next one after its calls: if a call fails, the step runs again.
    """

    def initialize(self) -> None:
        """Begin without any data."""
        self.missing = {"a picture", "the battery", "the pose"}
        self.red = NOTHING
        self.percent = 0.0
        self.place = ""
        self.base_fails = False
        self.step: Callable[[], None] = self.get_ready

    def compute(self) -> None:
        """Run the present step."""
        if not self.missing and self.percent <= 0:
            raise RuntimeError("the battery is empty: the mission has failed")
        self.step()

    def get_ready(self) -> None:
        """Start exploring when every publisher has sent a message."""
        if not self.missing:
            self.gotopoint_proxy.go("anywhere", 0.0, 0.0, 0.0)
            self.log.info("exploring, with %.0f %% of the battery", self.percent)
            self.step = self.explore

    def explore(self) -> None:
        """Look for a victim until the battery is low."""
        if self.victim_is_near:
            self.step = self.call_for_help
        elif self.percent < self.params.low:
            x, z = self.params.charger_x * 1000, self.params.charger_z * 1000
            self.gotopoint_proxy.go("charger", x, z, self.params.charger_alpha)
            self.log.info(
                "battery low (%.0f %%): going to the charging station", self.percent
            )
            self.step = self.reach_charger

    def reach_charger(self) -> None:
        """Drive to the charger, and look for a victim on the way."""
        if self.victim_is_near:
            self.step = self.call_for_help
        elif self.gotopoint_proxy.atTarget():
            self.log.info("at the charging station with %.0f %%", self.percent)
            self.step = self.charge

    def charge(self) -> None:
        """Stay until the battery is charged."""
        if self.percent >= self.params.enough:
            self.log.info("battery charged")
            self.step = self.get_ready

    def call_for_help(self) -> None:
        """Stop the robot, and say where the victim is."""
        self.gotopoint_proxy.stop()
        self.stop_base()
        text = f"A victim needs help near {self.place}"
        if self.speech_proxy.say(text, overwrite=True):
            self.log.info("found a victim near %s: calling for help", self.place)
            self.step = self.wait_until_said

    def stop_base(self) -> None:
        """Stop the robot. If its base fails, the mission goes on."""
        try:
            self.differentialrobot_proxy.stopBase()
        except RoboCompGenericBase.HardwareFailedException as failed:
            if not self.base_fails:
                self.log.error("the base fails: %s", failed)
            self.base_fails = True

    def wait_until_said(self) -> None:
        """End the mission when the text was spoken."""
        if not self.speech_proxy.isBusy():
            self.log.info("help was called: the mission is over")
            self.stop()

    @property
    def victim_is_near(self) -> bool:
        return self.red.height >= self.params.near

    def CameraSimplePub_pushImage(self, image: RoboCompCameraSimple.TImage) -> None:
        """Look for red pixels, because the victim wears red."""
        self.red = find_red(pixels_of(image.image, image.width, image.height))
        self.missing.discard("a picture")

    def BatteryStatusPub_pushBatteryState(
        self, battery: RoboCompBatteryStatus.TBattery
    ) -> None:
        """Keep the newest charge. One that is not finite was not measured."""
        if math.isfinite(battery.percentage):
            self.percent = battery.percentage
            self.missing.discard("the battery")

    def DifferentialRobotPub_pushBaseState(
        self, state: RoboCompGenericBase.TBaseState
    ) -> None:
        """Keep the newest place. One that is not finite is not known."""
        x, z = state.correctedX / 1000, state.correctedZ / 1000
        if math.isfinite(x) and math.isfinite(z):
            self.place = f"{x:.1f}, {z:.1f}"
            self.missing.discard("the pose")
