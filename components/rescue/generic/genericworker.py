# Generated from rescue.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of rescue, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

from robocomp_py.runtime.api import Component, Port, QoS, Verb, Worker

from . import (
    RoboCompBatteryStatus,
    RoboCompBatteryStatusPub,
    RoboCompCameraSimple,
    RoboCompCameraSimplePub,
    RoboCompDifferentialRobot,
    RoboCompDifferentialRobotPub,
    RoboCompGenericBase,
    RoboCompGotoPoint,
    RoboCompSpeech,
)
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "rescue",
        ports=(
            Port(
                Verb.REQUIRES,
                RoboCompSpeech.SPEECH_INTERFACE,
                proxy=RoboCompSpeech.SpeechProxy,
            ),
            Port(
                Verb.REQUIRES,
                RoboCompGotoPoint.GOTOPOINT_INTERFACE,
                proxy=RoboCompGotoPoint.GotoPointProxy,
            ),
            Port(
                Verb.REQUIRES,
                RoboCompDifferentialRobot.DIFFERENTIALROBOT_INTERFACE,
                proxy=RoboCompDifferentialRobot.DifferentialRobotProxy,
            ),
            Port(
                Verb.SUBSCRIBES,
                RoboCompCameraSimplePub.CAMERASIMPLEPUB_INTERFACE,
                qos=QoS(depth=1),
            ),
            Port(
                Verb.SUBSCRIBES,
                RoboCompBatteryStatusPub.BATTERYSTATUSPUB_INTERFACE,
                qos=QoS(depth=1),
            ),
            Port(
                Verb.SUBSCRIBES,
                RoboCompDifferentialRobotPub.DIFFERENTIALROBOTPUB_INTERFACE,
                qos=QoS(depth=1),
            ),
        ),
        params=PARAMS,
        period=0.1,
        description="The mission: find a victim before the battery is empty.",
    )
    middleware = "auto"

    speech_proxy: RoboCompSpeech.SpeechProxy
    gotopoint_proxy: RoboCompGotoPoint.GotoPointProxy
    differentialrobot_proxy: RoboCompDifferentialRobot.DifferentialRobotProxy

    @abstractmethod
    def CameraSimplePub_pushImage(self, image: RoboCompCameraSimple.TImage) -> None:
        """A picture, as soon as it is taken.

        IDSL: void pushImage(RoboCompCameraSimple::TImage image)
        """

    @abstractmethod
    def BatteryStatusPub_pushBatteryState(
        self,
        battery: RoboCompBatteryStatus.TBattery,
    ) -> None:
        """What is left now.

        IDSL: void pushBatteryState(RoboCompBatteryStatus::TBattery battery)
        """

    @abstractmethod
    def DifferentialRobotPub_pushBaseState(
        self,
        state: RoboCompGenericBase.TBaseState,
    ) -> None:
        """Where the base is and how it moves.

        IDSL: void pushBaseState(RoboCompGenericBase::TBaseState state)
        """
