"""Laser: distances in a plane."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ...contract.interface import Interface
from ...contract.types import Type
from ...innermodel.tree import Node
from ...runtime.instances import InstanceHandler
from .bases import state
from .values import filled, operation, rows

if TYPE_CHECKING:
    from ..world import World


def scanned(world: World, laser: str, kind: Type) -> Any:
    """A scan as a TLaserData: angles in rad, to the right; distances in mm."""
    return rows(kind, {"angle": world.angles(laser), "dist": world.scan(laser)})


class LaserHandler(InstanceHandler):
    def __init__(self, world: World, laser: Node, base: str, interface: Interface) -> None:
        """`base` is the base that carries the laser; "" if none does."""
        self._world, self._laser, self._base = world, laser, base
        self._scan = operation(interface, "getLaserData").outputs[0].type
        self._configuration = operation(interface, "getLaserConfData").outputs[0].type
        self._state = operation(interface, "getLaserAndBStateData").outputs[1].type

    def getLaserData(self) -> Any:
        """The scan of now, from the right to the left."""
        return scanned(self._world, self._laser.id, self._scan)

    def getLaserAndBStateData(self) -> tuple[Any, Any]:
        """The scan, and the state of the base that carries the laser; zeros if none does."""
        values = state(self._world, self._base) if self._base else {}
        return self.getLaserData(), filled(self._state, values)

    def getLaserConfData(self) -> Any:
        """What the file tells of the laser; angles in degrees there."""
        values = self._laser.values
        rays, field = int(str(values["measures"])), math.degrees(float(str(values["angle"])))
        return filled(
            self._configuration,
            {
                "driver": "simulated",
                "device": self._laser.id,
                "staticConf": 1,
                "maxMeasures": rays,
                "maxDegrees": round(field),
                "maxRange": round(float(str(values["max"]))),
                "minRange": round(float(str(values["min"]))),
                "endRange": round(field),
                "angleRes": field / rays,
                "angleIni": -field / 2,
            },
        )
