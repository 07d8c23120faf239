"""A camera on the robot's head: draws the view from the robot's pose."""

from __future__ import annotations

import math
from pathlib import Path

from .generic import RoboCompCameraSimple, RoboCompGenericBase
from .generic.genericworker import GenericWorker
from .view import Lens, read_house, render

TBaseState = RoboCompGenericBase.TBaseState
TImage = RoboCompCameraSimple.TImage


class SpecificWorker(GenericWorker):
    """Takes a picture at every compute, from the newest received pose."""

    def initialize(self) -> None:
        """Read the house. The pose is unknown until the first message."""
        self.house = read_house(Path(__file__).parent / self.params.map)
        angle = math.radians(self.params.field_of_view)
        self.lens = Lens(self.params.width, self.params.height, angle)
        self.pose: TBaseState | None = None
        self.picture: TImage | None = None

    def compute(self) -> None:
        """Take a picture and publish it."""
        if self.pose:
            self.picture = self.taken(self.pose)
            self.camerasimplepub_proxy.pushImage(self.picture)

    def taken(self, pose: TBaseState) -> TImage:
        """The picture from a pose."""
        x, z = pose.correctedX / 1000, pose.correctedZ / 1000
        pixels = render(self.house, self.lens, x, z, pose.correctedAlpha)
        height, width, depth = pixels.shape
        return TImage(False, width, height, depth, pixels.ravel())

    def DifferentialRobotPub_pushBaseState(self, state: TBaseState) -> None:
        """Keep the newest pose, except one whose numbers are not finite."""
        pose = state.correctedX, state.correctedZ, state.correctedAlpha
        if all(map(math.isfinite, pose)):
            self.pose = state

    def CameraSimple_getImage(self) -> TImage:
        """The newest picture; HardwareFailedException before there is one."""
        if not self.picture:
            reason = "no picture yet: the pose of the robot is unknown"
            raise RoboCompCameraSimple.HardwareFailedException(reason)
        return self.picture
