# Generated from OmniRobot.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompOmniRobot: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import (
    FLOAT32,
    INT32,
    STRING,
    Field,
    Future,
    Interface,
    Operation,
    Proxy,
    Struct,
)

from . import RoboCompGenericBase


@dataclass(slots=True)
class TMechParams:
    """How a base is built."""

    temp: float = 0.0  # degrees Celsius
    device: str = ""  # where it is connected
    handler: str = ""  # kind of hardware or simulator
    maxVelAdv: float = 0.0  # mm/s
    maxVelRot: float = 0.0  # rad/s

    __contract__: ClassVar[Struct]


TMechParams.__contract__ = Struct(
    "RoboCompOmniRobot::TMechParams",
    (
        Field("temp", FLOAT32, doc="degrees Celsius"),
        Field("device", STRING, doc="where it is connected"),
        Field("handler", STRING, doc="kind of hardware or simulator"),
        Field("maxVelAdv", FLOAT32, doc="mm/s"),
        Field("maxVelRot", FLOAT32, doc="rad/s"),
    ),
    TMechParams,
    doc="How a base is built.",
)

_OmniRobot_getBaseState: Operation[RoboCompGenericBase.TBaseState] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "getBaseState",
    outputs=(Field("state", RoboCompGenericBase.TBaseState.__contract__),),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Where the base is and how it moves.",
)
_OmniRobot_getBasePose: Operation[tuple[int, int, float]] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "getBasePose",
    outputs=(
        Field("x", INT32),
        Field("z", INT32),
        Field("alpha", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Where the base is by its odometer: mm, mm, rad.",
)
_OmniRobot_setSpeedBase: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "setSpeedBase",
    inputs=(
        Field("advx", FLOAT32),
        Field("advz", FLOAT32),
        Field("rot", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Drive with these speeds from now on: mm/s to the right, mm/s forwards, rad/s to the right.\nRepeat it while driving: a base may stop when no new speeds arrive for a while.",  # noqa: E501, RUF100
)
_OmniRobot_stopBase: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "stopBase",
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Stand still.",
)
_OmniRobot_resetOdometer: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "resetOdometer",
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Call the present pose 0, 0, 0.",
)
_OmniRobot_setOdometer: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "setOdometer",
    inputs=(Field("state", RoboCompGenericBase.TBaseState.__contract__),),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Take pose and best estimate from a state; its speeds do not matter.",
)
_OmniRobot_setOdometerPose: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "setOdometerPose",
    inputs=(
        Field("x", INT32),
        Field("z", INT32),
        Field("alpha", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Call the present pose this: mm, mm, rad.",
)
_OmniRobot_correctOdometer: Operation[None] = Operation(
    "RoboCompOmniRobot::OmniRobot",
    "correctOdometer",
    inputs=(
        Field("x", INT32),
        Field("z", INT32),
        Field("alpha", FLOAT32),
    ),
    raises=(RoboCompGenericBase.HardwareFailedException.__contract__,),
    doc="Replace the best estimate, and leave the odometer as it is: mm, mm, rad.",
)
OMNIROBOT_INTERFACE = Interface(
    "RoboCompOmniRobot::OmniRobot",
    (
        _OmniRobot_getBaseState,
        _OmniRobot_getBasePose,
        _OmniRobot_setSpeedBase,
        _OmniRobot_stopBase,
        _OmniRobot_resetOdometer,
        _OmniRobot_setOdometer,
        _OmniRobot_setOdometerPose,
        _OmniRobot_correctOdometer,
    ),
)


class OmniRobotProxy(Proxy):
    """Calls OmniRobot of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = OMNIROBOT_INTERFACE

    def getBaseState(
        self,
        *,
        deadline: float | None = None,
    ) -> RoboCompGenericBase.TBaseState:
        """Where the base is and how it moves.

        IDSL: void getBaseState(out RoboCompGenericBase::TBaseState state) throws
        RoboCompGenericBase::HardwareFailedException
        """
        return self._ask(_OmniRobot_getBaseState, (), deadline)

    def getBaseStateAsync(
        self,
        *,
        deadline: float | None = None,
    ) -> Future[RoboCompGenericBase.TBaseState]:
        """Call `getBaseState` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_OmniRobot_getBaseState, (), deadline)

    def getBasePose(self, *, deadline: float | None = None) -> tuple[int, int, float]:
        """Where the base is by its odometer: mm, mm, rad.

        IDSL: void getBasePose(out int x, out int z, out float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """
        return self._ask(_OmniRobot_getBasePose, (), deadline)

    def getBasePoseAsync(
        self,
        *,
        deadline: float | None = None,
    ) -> Future[tuple[int, int, float]]:
        """Call `getBasePose` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_OmniRobot_getBasePose, (), deadline)

    def setSpeedBase(
        self,
        advx: float,
        advz: float,
        rot: float,
        *,
        deadline: float | None = None,
    ) -> None:
        """Drive with these speeds from now on: mm/s to the right, mm/s forwards, rad/s
        to the right. Repeat it while driving: a base may stop when no new speeds arrive
        for a while.

        IDSL: void setSpeedBase(float advx, float advz, float rot) throws
        RoboCompGenericBase::HardwareFailedException
        """
        return self._ask(_OmniRobot_setSpeedBase, (advx, advz, rot), deadline)

    def setSpeedBaseAsync(
        self,
        advx: float,
        advz: float,
        rot: float,
        *,
        deadline: float | None = None,
    ) -> Future[None]:
        """Call `setSpeedBase` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_OmniRobot_setSpeedBase, (advx, advz, rot), deadline)

    def stopBase(self, *, deadline: float | None = None) -> None:
        """Stand still.

        IDSL: void stopBase() throws RoboCompGenericBase::HardwareFailedException
        """
        return self._ask(_OmniRobot_stopBase, (), deadline)

    def stopBaseAsync(self, *, deadline: float | None = None) -> Future[None]:
        """Call `stopBase` without waiting. The Future is done within the deadline."""
        return self._ask_async(_OmniRobot_stopBase, (), deadline)

    def resetOdometer(self, *, deadline: float | None = None) -> None:
        """Call the present pose 0, 0, 0.

        IDSL: void resetOdometer() throws RoboCompGenericBase::HardwareFailedException
        """
        return self._ask(_OmniRobot_resetOdometer, (), deadline)

    def resetOdometerAsync(self, *, deadline: float | None = None) -> Future[None]:
        """Call `resetOdometer` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_OmniRobot_resetOdometer, (), deadline)

    def setOdometer(
        self,
        state: RoboCompGenericBase.TBaseState,
        *,
        deadline: float | None = None,
    ) -> None:
        """Take pose and best estimate from a state; its speeds do not matter.

        IDSL: void setOdometer(RoboCompGenericBase::TBaseState state) throws
        RoboCompGenericBase::HardwareFailedException
        """
        return self._ask(_OmniRobot_setOdometer, (state,), deadline)

    def setOdometerAsync(
        self,
        state: RoboCompGenericBase.TBaseState,
        *,
        deadline: float | None = None,
    ) -> Future[None]:
        """Call `setOdometer` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_OmniRobot_setOdometer, (state,), deadline)

    def setOdometerPose(
        self,
        x: int,
        z: int,
        alpha: float,
        *,
        deadline: float | None = None,
    ) -> None:
        """Call the present pose this: mm, mm, rad.

        IDSL: void setOdometerPose(int x, int z, float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """
        return self._ask(_OmniRobot_setOdometerPose, (x, z, alpha), deadline)

    def setOdometerPoseAsync(
        self,
        x: int,
        z: int,
        alpha: float,
        *,
        deadline: float | None = None,
    ) -> Future[None]:
        """Call `setOdometerPose` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_OmniRobot_setOdometerPose, (x, z, alpha), deadline)

    def correctOdometer(
        self,
        x: int,
        z: int,
        alpha: float,
        *,
        deadline: float | None = None,
    ) -> None:
        """Replace the best estimate, and leave the odometer as it is: mm, mm, rad.

        IDSL: void correctOdometer(int x, int z, float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """
        return self._ask(_OmniRobot_correctOdometer, (x, z, alpha), deadline)

    def correctOdometerAsync(
        self,
        x: int,
        z: int,
        alpha: float,
        *,
        deadline: float | None = None,
    ) -> Future[None]:
        """Call `correctOdometer` without waiting. The Future is done within the
        deadline.
        """
        return self._ask_async(_OmniRobot_correctOdometer, (x, z, alpha), deadline)
