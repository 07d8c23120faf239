"""JointMotor: the joints of one port."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from ...contract.interface import Interface
from ...contract.types import Dictionary, Sequence, Type
from ...innermodel.read import number_of
from ...innermodel.tree import Node
from ...runtime.instances import InstanceHandler
from ...spelling import unknown
from .values import declared, filled, operation

if TYPE_CHECKING:
    from ..world import World


def states(world: World, joints: Iterable[str], kind: Type) -> dict[str, Any]:
    """A MotorStateMap: rad and rad/s, or mm and mm/s of joints that slide."""
    assert isinstance(kind, Dictionary)
    return {name: filled(kind.value, _state(world, name)) for name in joints}


def _state(world: World, joint: str) -> dict[str, Any]:
    return {
        "pos": world.position(joint),
        "vel": world.joint_speed(joint),
        "isMoving": world.is_moving(joint),
        "timeStamp": f"{world.time:.3f}",  # simulated seconds
    }


class JointMotorHandler(InstanceHandler):
    """Answers for all joints of a port: in rad and rad/s, or in mm and mm/s for joints that slide.

    Goals outside of a joint's limits are moved to the limit. An unknown joint raises UnknownMotorException, a number
    that is not finite HardwareFailedException.
    """

    def __init__(self, world: World, instance: str, joints: Mapping[str, Node], interface: Interface) -> None:
        self._world, self._instance, self._interface = world, instance, interface
        self.joints = joints
        """By their ids. Edits of the scene add and remove some."""

    def setPosition(self, goal: Any) -> None:
        """Move a joint at `maxSpeed`; 0: at once."""
        self._move("setPosition", {goal.name: (goal.position, goal.maxSpeed)})

    def setVelocity(self, goal: Any) -> None:
        """Move a joint at a speed that changes by at most `maxAcc` per second; 0: at once."""
        self._drive("setVelocity", {goal.name: (goal.velocity, goal.maxAcc)})

    def setZeroPos(self, name: str) -> None:
        """Move a joint to its `home`, at once."""
        self._check("setZeroPos", [name])
        self._move("setZeroPos", {name: (self._home(name), 0.0)})

    def setSyncPosition(self, listGoals: Any) -> None:
        """Move joints; if one goal cannot be, none is taken."""
        self._move("setSyncPosition", {goal.name: (goal.position, goal.maxSpeed) for goal in listGoals})

    def setSyncVelocity(self, listGoals: Any) -> None:
        """Move joints at speeds; if one goal cannot be, none is taken."""
        self._drive("setSyncVelocity", {goal.name: (goal.velocity, goal.maxAcc) for goal in listGoals})

    def setSyncZeroPos(self) -> None:
        """Move all joints to their `home`, at once."""
        self._move("setSyncZeroPos", {name: (self._home(name), 0.0) for name in self.joints})

    def getMotorParams(self, motor: str) -> Any:
        """What the file tells of a joint. A limit that it does not tell is infinite."""
        self._check("getMotorParams", [motor])
        return filled(self._returned("getMotorParams"), self._parameters(motor))

    def getMotorState(self, motor: str) -> Any:
        """Position and speed of a joint now."""
        self._check("getMotorState", [motor])
        return filled(self._returned("getMotorState"), _state(self._world, motor))

    def getMotorStateMap(self, mList: list[str]) -> dict[str, Any]:
        """Positions and speeds of some joints now."""
        self._check("getMotorStateMap", mList)
        return states(self._world, mList, self._returned("getMotorStateMap"))

    def getAllMotorState(self) -> dict[str, Any]:
        """Positions and speeds of all joints now."""
        return states(self._world, self.joints, self._returned("getAllMotorState"))

    def getAllMotorParams(self) -> list[Any]:
        """What the file tells of all joints."""
        kind = self._returned("getAllMotorParams")
        assert isinstance(kind, Sequence)
        return [filled(kind.item, self._parameters(name)) for name in self.joints]

    def getBusParams(self) -> Any:
        """A bus that exchanges values in each tick."""
        values = {
            "handler": "simulated",
            "device": self._instance,
            "numMotors": len(self.joints),
            "basicPeriod": round(self._world.tick * 1000),
        }
        return filled(self._returned("getBusParams"), values)

    def _parameters(self, joint: str) -> dict[str, Any]:
        values = self.joints[joint].values
        return {"name": joint, "minPos": values["min"], "maxPos": values["max"], "zeroPos": values["home"]}

    def _home(self, joint: str) -> float:
        return number_of(self.joints[joint].values["home"])

    def _returned(self, name: str) -> Type:
        return operation(self._interface, name).outputs[0].type

    def _move(self, name: str, goals: Mapping[str, tuple[float, float]]) -> None:
        self._check(name, goals)
        try:
            self._world.move_joints(goals)
        except ValueError as exc:
            raise declared(self._interface, name, "HardwareFailedException", str(exc)) from exc

    def _drive(self, name: str, goals: Mapping[str, tuple[float, float]]) -> None:
        self._check(name, goals)
        try:
            self._world.drive_joints(goals)
        except ValueError as exc:
            raise declared(self._interface, name, "HardwareFailedException", str(exc)) from exc

    def _check(self, name: str, joints: Iterable[str]) -> None:
        for each in joints:
            if each not in self.joints:
                text = unknown("motor", each, self.joints)
                raise declared(self._interface, name, "UnknownMotorException", text)
