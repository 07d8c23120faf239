"""Simulates arena.xml, and the battery of its robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from robocomp_py.sim.serve.simulator import Simulator

from .battery import Battery
from .film import Film
from .generic import RoboCompBatteryStatus
from .generic.genericworker import GenericWorker

TBattery = RoboCompBatteryStatus.TBattery
BatteryStates = RoboCompBatteryStatus.BatteryStates

BASE, LASER, CHARGER, OVERVIEW = "base", "laser", "charger", "overview"
"""Nodes of the scene."""

REACH_M = 0.5
"""The robot is charged this near to the middle of the charging station."""


class SpecificWorker(Simulator, GenericWorker):
    """`Simulator` provides everything of the scene. It knows no batteries, so they are
    simulated here.
    """

    film: Film | None = None

    def initialize(self) -> None:
        """Read the scene, and begin with the battery that is configured."""
        super().initialize()
        self.begin()

    def begin(self) -> None:
        """Begin at tick 0: what the file of the scene does not say."""
        self.world.set_noise(LASER, self.params.laser_noise)
        self.battery = Battery(self.params.capacity, self.params.battery)
        self.film = Film() if self.params.film else None
        self.lived_s = 0.0

    def compute(self) -> None:
        """Go on to the present time, and publish."""
        if self.battery.is_empty:
            self.world.drive(BASE)  # before time passes, so commands have no effect
        super().compute()
        self.live()
        self.batterystatuspub_proxy.pushBatteryState(self.battery_state())
        if self.film:
            self.film.note(self.world)

    def live(self) -> None:
        """Drain or charge the battery for the time that has passed in the scene."""
        passed = self.world.time - self.lived_s
        self.lived_s = self.world.time
        if passed > 0.0:  # not in a pause, nor after a state was restored
            truth = self.world.truth(BASE)
            driven = float(np.linalg.norm(truth.velocity)) * passed
            turned = float(np.linalg.norm(truth.turning)) * passed
            self.battery.step(passed, driven, turned, charging=self.is_at_charger)

    @property
    def is_at_charger(self) -> bool:
        away_mm = self.world.matrix(CHARGER, seen_from=BASE)[:3, 3]
        return float(np.linalg.norm(away_mm)) < REACH_M * 1000

    def finish(self) -> None:
        """Draw the film, if one is configured."""
        super().finish()
        if self.film:
            path = Path(self.params.film).resolve()
            self.log.info("draws a film of what happened, which takes some seconds")
            self.film.draw(OVERVIEW, path)
            self.log.info("a film of what happened is in %s", path)

    def battery_state(self) -> TBattery:
        """The state of the battery."""
        battery = self.battery
        state = BatteryStates.Charged if battery.is_full else BatteryStates.Charging
        return TBattery(
            percentage=battery.percent,
            state=state if battery.charging else BatteryStates.Disconnected,
            voltage=battery.volts,
            current=battery.power_w / battery.volts,
            timeToGo=battery.seconds_to_go,
            power=battery.power_w,
            consumptionPerHour=max(0.0, -battery.power_w),
        )

    def BatteryStatus_getBatteryState(self) -> TBattery:
        return self.battery_state()

    def Simulation_reset(self, seed: int) -> None:
        """Begin again, also with the battery."""
        super().Simulation_reset(seed)
        self.begin()
