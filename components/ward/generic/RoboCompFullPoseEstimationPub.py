# Generated from FullPoseEstimationPub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompFullPoseEstimationPub: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import Field, Interface, Operation, Proxy

from . import RoboCompFullPoseEstimation

_FullPoseEstimationPub_newFullPose: Operation[None] = Operation(
    "RoboCompFullPoseEstimationPub::FullPoseEstimationPub",
    "newFullPose",
    inputs=(Field("pose", RoboCompFullPoseEstimation.FullPoseEuler.__contract__),),
    doc="The pose and its speeds.",
)
FULLPOSEESTIMATIONPUB_INTERFACE = Interface(
    "RoboCompFullPoseEstimationPub::FullPoseEstimationPub",
    (_FullPoseEstimationPub_newFullPose,),
)


class FullPoseEstimationPubPublisher(Proxy):
    """Publishes FullPoseEstimationPub. A call waits only if its QoS is reliable."""

    interface = FULLPOSEESTIMATIONPUB_INTERFACE

    def newFullPose(
        self,
        pose: RoboCompFullPoseEstimation.FullPoseEuler,
        *,
        deadline: float | None = None,
    ) -> None:
        """The pose and its speeds.

        IDSL: void newFullPose(RoboCompFullPoseEstimation::FullPoseEuler pose)
        """
        self._send(_FullPoseEstimationPub_newFullPose, (pose,), deadline)
