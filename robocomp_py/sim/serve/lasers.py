"""Laser: distances in a plane; and Lidar3D: points in space, x ahead, y to the left, z up, in m."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ...contract.interface import Interface
from ...contract.types import Struct, Type
from ...errors import ArgumentError
from ...innermodel import axes
from ...innermodel.axes import Array
from ...innermodel.read import number_of
from ...innermodel.tree import Node
from ...runtime.instances import InstanceHandler
from .bases import state
from .offers import carried_by
from .values import filled, operation, records, rows

if TYPE_CHECKING:
    from ..world import World

_AROUND = math.tau - 1e-6
"""An angle from which on a sector has all directions, rad: floats of 32 bits may be a little less than a full turn."""

_NEAR = math.radians(0.5)
"""How far a point may be from the direction that a decimation keeps, rad."""


def scanned(world: World, laser: str) -> dict[str, Array]:
    """The columns of a TLaserData: angles in rad, to the right; distances in mm."""
    return {"angle": world.angles(laser), "dist": world.scan(laser)}


class LaserHandler(InstanceHandler):
    def __init__(self, world: World, laser: Node, interface: Interface) -> None:
        self._world, self._laser = world, laser
        self._scan = operation(interface, "getLaserData").outputs[0].type
        self._configuration = operation(interface, "getLaserConfData").outputs[0].type
        self._state = operation(interface, "getLaserAndBStateData").outputs[1].type

    def getLaserData(self) -> Any:
        """The scan of now, from the right to the left."""
        return rows(self._scan, scanned(self._world, self._laser.id))

    def getLaserData_records(self) -> Any:
        """The same as an array of records; see `gym.driving`."""
        return records(self._scan, scanned(self._world, self._laser.id))

    def getLaserAndBStateData(self) -> tuple[Any, Any]:
        """The scan, and the state of the base at `ifconfig`, else of the base that carries it; zeros without a base."""
        base, _ = carried_by(self._world.tree, self._laser.id)
        values = state(self._world, base) if base else {}
        return self.getLaserData(), filled(self._state, values)

    def getLaserConfData(self) -> Any:
        """What the file tells of the laser: ranges in mm, and angles in degrees, unlike those of a scan."""
        values = self._laser.values
        rays, field = int(number_of(values["measures"])), math.degrees(number_of(values["angle"]))
        return filled(
            self._configuration,
            {
                "driver": "simulated",
                "device": self._laser.id,
                "staticConf": 1,
                "maxMeasures": rays,
                "maxDegrees": round(field),
                "maxRange": round(number_of(values["max"])),
                "minRange": round(number_of(values["min"])),
                "endRange": round(field),
                "angleRes": field / rays,
                "angleIni": -field / 2,
            },
        )


def classified(cloud: Array, kind: Type, *, period: float, time: int) -> Any:
    """A cloud of points as a TDataCategory; what they belong to is not known. `period` in s, `time` in ms."""
    x, y, z = axes.position_to_simulation(cloud).astype(np.float32).T.copy()
    values = {"XArray": x, "YArray": y, "ZArray": z, "CategoriesArray": np.zeros(len(x), np.int32)}
    return filled(kind, values | {"period": period * 1000.0, "timestamp": time})


class Lidar3DHandler(InstanceHandler):
    """The argument `name` has no effect: an instance has one lidar."""

    def __init__(
        self, world: World, lidar: str, now: Callable[[], int], period: Callable[[], float], interface: Interface
    ) -> None:
        """`now` is the clock of the component, ns; `period` is that of its publications, s."""
        self._world, self._lidar, self._now, self._period = world, lidar, now, period
        self._interface = interface

    def getLidarData(self, name: str, start: float, len: float, decimationDegreeFactor: int) -> Any:
        """The points of now in a sector, rad."""
        points = self._points()
        if len < _AROUND:
            turned = (points["phi"] - start) % math.tau
            points = {key: values[turned <= len] for key, values in points.items()}
        return self._told("getLidarData", points, decimationDegreeFactor)

    def getLidarDataWithThreshold2d(self, name: str, distance: float, decimationDegreeFactor: int) -> Any:
        """The points of now that are near, m."""
        points = self._points()
        near = points["distance2d"] <= distance
        points = {key: values[near] for key, values in points.items()}
        return self._told("getLidarDataWithThreshold2d", points, decimationDegreeFactor)

    # Other calls of RoboComp's newer versions, for components whose IDSL has them.

    def getLidarDataProyectedInImage(self, name: str) -> Any:
        """Raises ArgumentError: there is no such picture."""
        raise ArgumentError("a scene has no picture of all directions, on which points could be projected")

    def getLidarDataArrayProyectedInImage(self, name: str) -> Any:
        """Raises ArgumentError: there is no such picture."""
        self.getLidarDataProyectedInImage(name)

    def getColorCloudData(self) -> Any:
        """Raises ArgumentError: there is no such picture."""
        self.getLidarDataProyectedInImage("")

    def getLidarDataByCategory(self, categories: Any, timestamp: int) -> Any:
        """Raises ArgumentError: the simulator does not classify points."""
        raise ArgumentError("nothing classifies the points of a simulated lidar")

    def _points(self) -> dict[str, Array]:
        """The fields of all points of now; lengths in m."""
        x, y, z = axes.position_to_simulation(self._world.cloud(self._lidar)).T
        away = np.hypot(x, y)
        found = {"x": x, "y": y, "z": z, "phi": np.arctan2(-y, x), "theta": np.arctan2(away, z)}
        return found | {"r": np.hypot(away, z), "distance2d": away}

    def _told(self, name: str, points: dict[str, Array], decimation: int) -> Any:
        if decimation > 1:
            degrees = math.radians(decimation)
            beside = np.abs(points["phi"] - np.round(points["phi"] / degrees) * degrees)
            points = {key: values[beside <= _NEAR] for key, values in points.items()}
        kind = operation(self._interface, name).outputs[0].type
        assert isinstance(kind, Struct)
        cloud = {each.name: rows(each.type, points) for each in kind.fields if each.name == "points"}
        return filled(kind, cloud | {"period": self._period() * 1000.0, "timestamp": self._now() // 1_000_000})
