"""DifferentialRobot and OmniRobot: bases that drive."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, NoReturn

from ...contract.interface import Interface
from ...errors import ArgumentError
from ...runtime.instances import InstanceHandler
from ..bases import Pose
from .values import filled, operation

if TYPE_CHECKING:
    from ..world import World

log = logging.getLogger("robocomp.sim")

SLOW = 2.0
"""mm/s. A first speed below this was probably meant in m/s."""

_NOTHING = 0.01
"""mm/s. Lower speeds count as 0: they come from rounding."""


def state(world: World, base: str) -> dict[str, Any]:
    """The fields of a TBaseState: mm, rad, mm/s, rad/s."""
    odometry, corrected, speed = world.odometry(base), world.corrected(base), world.speed(base)
    return {
        "x": odometry.x,
        "z": odometry.z,
        "alpha": odometry.turn,
        "correctedX": corrected.x,
        "correctedZ": corrected.z,
        "correctedAlpha": corrected.turn,
        "advVx": speed.aside,
        "advVz": speed.ahead,
        "rotV": speed.turn,
        "isMoving": any(speed),
    }


class BaseHandler(InstanceHandler):
    """What both kinds of bases answer. Lengths are in mm, angles in rad, to the right.

    Numbers that are not finite raise HardwareFailedException.
    """

    def __init__(self, world: World, base: str, interface: Interface) -> None:
        self._world, self._base = world, base
        self._state = operation(interface, "getBaseState").outputs[0].type
        self._failed = operation(interface, "stopBase").raises
        self._has_driven = False

    def getBaseState(self) -> Any:
        """Where the base is by its wheels, and by its last correction; mm and rad."""
        return filled(self._state, state(self._world, self._base))

    def getBasePose(self) -> tuple[int, int, float]:
        """Where the base is by its wheels."""
        pose = self._world.odometry(self._base)
        return round(pose.x), round(pose.z), pose.turn

    def stopBase(self) -> None:
        """Stop at once, as far as physics lets it."""
        self._world.drive(self._base)

    def resetOdometer(self) -> None:
        """Let the odometry, and its correction, go on from 0."""
        self._world.set_odometry(self._base)

    def setOdometer(self, state: Any) -> None:
        """Let the odometry, and its correction, go on from those of a TBaseState."""
        corrected = Pose(state.correctedX, state.correctedZ, state.correctedAlpha)
        try:
            self._world.set_odometry(self._base, state.x, state.z, state.alpha, corrected)
        except ValueError as exc:
            self._refuse(exc)

    def setOdometerPose(self, x: int, z: int, alpha: float) -> None:
        """Let the odometry, and its correction, go on from a pose."""
        try:
            self._world.set_odometry(self._base, x, z, alpha)
        except ValueError as exc:
            self._refuse(exc)

    def correctOdometer(self, x: int, z: int, alpha: float) -> None:
        """Let the correction go on from a pose. The odometry stays as it is."""
        try:
            self._world.correct_odometry(self._base, x, z, alpha)
        except ValueError as exc:
            self._refuse(exc)

    def _drive(self, ahead: float, aside: float, turn: float) -> None:
        try:
            self._world.drive(self._base, ahead, aside, turn)
        except ValueError as exc:
            self._refuse(exc)
        if not self._has_driven and (fastest := max(abs(ahead), abs(aside))) > _NOTHING:
            self._has_driven = True
            if fastest < SLOW:
                text = "`%s` was told to drive at %.3g mm/s, which hardly moves it: this interface takes mm/s, not m/s"
                log.warning(text, self._base, fastest)

    def _refuse(self, error: ValueError) -> NoReturn:
        for each in self._failed:
            if each.python is not None:
                raise each.python(str(error)) from error
        raise ArgumentError(str(error)) from error


class DifferentialRobotHandler(BaseHandler):
    def setSpeedBase(self, adv: float, rot: float) -> None:
        """Drive at mm/s and rad/s, to the right."""
        self._drive(adv, 0.0, rot)


class OmniRobotHandler(BaseHandler):
    def setSpeedBase(self, advx: float, advz: float, rot: float) -> None:
        """Drive at mm/s to the right, mm/s ahead and rad/s, to the right."""
        self._drive(advz, advx, rot)
