"""IMU, TouchSensor and FullPoseEstimation: what a robot feels, and where it truly is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...contract.interface import Interface
from ...contract.types import Dictionary, Struct, Type
from ...errors import ArgumentError
from ...runtime.instances import InstanceHandler
from .values import filled, operation

if TYPE_CHECKING:
    from ..world import World

_XYZ = ("X", "Y", "Z")

_PLACE, _SPEED = ("x", "y", "z", "rx", "ry", "rz"), ("vx", "vy", "vz", "vrx", "vry", "vrz")
"""Fields of a FullPoseEuler."""


def measured(world: World, imu: str, kind: Type) -> Any:
    """A DataImu: m/s², rad/s and rad."""
    assert isinstance(kind, Struct)
    kinds, values = {each.name: each.type for each in kind.fields}, _imu(world, imu)
    return filled(kind, {name: filled(kinds[name], parts) for name, parts in values.items() if name in kinds})


def _imu(world: World, imu: str) -> dict[str, dict[str, float]]:
    found = world.inertial(imu)
    return {
        "acc": {f"{axis}Acc": value for axis, value in zip(_XYZ, found.acceleration.tolist(), strict=True)},
        "gyro": {f"{axis}Gyr": value for axis, value in zip(_XYZ, found.gyroscope.tolist(), strict=True)},
        "mag": {f"{axis}Mag": value for axis, value in zip(_XYZ, found.magnetic.tolist(), strict=True)},
        "rot": {"Roll": found.roll, "Pitch": found.pitch, "Yaw": found.yaw},
    }


def posed(world: World, node: str, kind: Type) -> Any:
    """A FullPoseEuler: m, rad, m/s and rad/s."""
    position, angles, velocity, turning, rotation = world.truth(node)
    own = rotation.T
    side, _, ahead = (own.dot(velocity) + 0.0).tolist()  # 0, and not -0
    values: dict[str, Any] = {"source": node, "adv": ahead, "side": side, "confidence": 100}
    values["rot"] = own.dot(turning).item(1) + 0.0
    values.update(zip(_PLACE, (*position.tolist(), *angles.tolist()), strict=True))
    values.update(zip(_SPEED, (*velocity.tolist(), *turning.tolist()), strict=True))
    return filled(kind, values)


class _SensorHandler(InstanceHandler):
    def __init__(self, world: World, node: str, interface: Interface) -> None:
        self._world, self._node, self._interface = world, node, interface
        self._kinds: dict[str, Type] = {}

    def _returned(self, name: str) -> Type:
        if name not in self._kinds:
            self._kinds[name] = operation(self._interface, name).outputs[0].type
        return self._kinds[name]


class IMUHandler(_SensorHandler):
    def getDataImu(self) -> Any:
        """All that it measures now."""
        return measured(self._world, self._node, self._returned("getDataImu"))

    def getAcceleration(self) -> Any:
        """Its proper acceleration, m/s²: at rest, 9.81 upwards."""
        return self._part("getAcceleration", "acc")

    def getAngularVel(self) -> Any:
        """How fast it turns, rad/s."""
        return self._part("getAngularVel", "gyro")

    def getMagneticFields(self) -> Any:
        """The direction of the magnetic field, of length 1."""
        return self._part("getMagneticFields", "mag")

    def getOrientation(self) -> Any:
        """How it is turned, rad."""
        return self._part("getOrientation", "rot")

    def resetImu(self) -> None:
        """Call the present yaw 0."""
        self._world.reset_imu(self._node)

    def _part(self, name: str, part: str) -> Any:
        return filled(self._returned(name), _imu(self._world, self._node)[part])


class TouchSensorHandler(_SensorHandler):
    def getValues(self) -> dict[str, Any]:
        """What presses on it, N; of a bumper, whether something does."""
        kind = self._returned("getValues")
        assert isinstance(kind, Dictionary)
        value = self._world.touch(self._node)
        return {self._node: filled(kind.value, {"name": self._node, "value": value})}


class FullPoseEstimationHandler(_SensorHandler):
    def setInitialPose(self, x: float, y: float, z: float, rx: float, ry: float, rz: float) -> None:
        """Raises ArgumentError: the pose is the true one."""
        raise ArgumentError("this pose is the true one, and no estimate that begins anywhere; setPose moves a base")

    def getFullPoseEuler(self) -> Any:
        """Where it is and how it moves: m, rad, m/s and rad/s."""
        return posed(self._world, self._node, self._returned("getFullPoseEuler"))

    def getFullPoseMatrix(self) -> Any:
        """Where it is, as a matrix; lengths in m."""
        matrix = self._world.matrix(self._node)
        matrix[:3, 3] /= 1000.0
        values = {f"m{row}{column}": float(matrix[row, column]) for row in range(4) for column in range(4)}
        return filled(self._returned("getFullPoseMatrix"), {"source": self._node, **values})
