# Generated from camera.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of camera, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

from robocomp_py.runtime.api import Component, Port, QoS, Verb, Worker

from . import (
    RoboCompCameraSimple,
    RoboCompCameraSimplePub,
    RoboCompDifferentialRobotPub,
    RoboCompGenericBase,
)
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "camera",
        ports=(
            Port(
                Verb.SUBSCRIBES,
                RoboCompDifferentialRobotPub.DIFFERENTIALROBOTPUB_INTERFACE,
                qos=QoS(depth=1),
            ),
            Port(Verb.IMPLEMENTS, RoboCompCameraSimple.CAMERASIMPLE_INTERFACE),
            Port(
                Verb.PUBLISHES,
                RoboCompCameraSimplePub.CAMERASIMPLEPUB_INTERFACE,
                qos=QoS(depth=5),
                proxy=RoboCompCameraSimplePub.CameraSimplePubPublisher,
            ),
        ),
        params=PARAMS,
        period=0.1,
        description="Draws what a camera on the robot would see.",
    )
    middleware = "auto"

    camerasimplepub_proxy: RoboCompCameraSimplePub.CameraSimplePubPublisher

    @abstractmethod
    def DifferentialRobotPub_pushBaseState(
        self,
        state: RoboCompGenericBase.TBaseState,
    ) -> None:
        """Where the base is and how it moves.

        IDSL: void pushBaseState(RoboCompGenericBase::TBaseState state)
        """

    @abstractmethod
    def CameraSimple_getImage(self) -> RoboCompCameraSimple.TImage:
        """The newest picture.

        IDSL: TImage getImage() throws HardwareFailedException
        """
