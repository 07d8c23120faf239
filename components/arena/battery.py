"""The battery of the robot: driving drains it, the charging station charges it."""

from __future__ import annotations

from dataclasses import dataclass

AWAKE_W = 0.7
DRIVING_J_PER_M = 80.0
TURNING_J_PER_RAD = 11.0
CHARGING_W = 360.0

EMPTY_V, FULL_V = 22.0, 26.0


@dataclass(slots=True)
class Battery:
    """What is left, and what flows."""

    capacity_wh: float
    percent: float
    power_w: float = 0.0
    """What flows into it, on average over the last step; negative if it is drained."""
    charging: bool = False

    def step(
        self, seconds: float, driven_m: float, turned_rad: float, *, charging: bool
    ) -> None:
        """Let these seconds pass."""
        used = (
            AWAKE_W * seconds
            + DRIVING_J_PER_M * driven_m
            + TURNING_J_PER_RAD * turned_rad
        )
        gained = CHARGING_W * seconds if charging else 0.0
        before = self.percent
        change = (gained - used) / (self.capacity_wh * 3600) * 100
        self.percent = min(max(before + change, 0.0), 100.0)
        self.power_w = (self.percent - before) / 100 * self.capacity_wh * 3600 / seconds
        self.charging = charging

    @property
    def is_empty(self) -> bool:
        return self.percent <= 0.0

    @property
    def is_full(self) -> bool:
        return self.percent >= 100.0

    @property
    def volts(self) -> float:
        """The voltage; it falls slightly as the battery empties."""
        return EMPTY_V + (FULL_V - EMPTY_V) * self.percent / 100

    @property
    def seconds_to_go(self) -> float:
        """Until it is full or empty, if the power stays the same; 0 if none flows."""
        if not self.power_w:
            return 0.0
        left = (100.0 if self.power_w > 0 else 0.0) - self.percent
        return left / 100 * self.capacity_wh * 3600 / self.power_w
