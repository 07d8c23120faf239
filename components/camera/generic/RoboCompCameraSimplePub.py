# Generated from CameraSimplePub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompCameraSimplePub: what travels, and how to send it."""

from __future__ import annotations

from contextlib import AbstractContextManager

from robocomp_py.runtime.api import Field, Interface, Operation, Proxy

from . import RoboCompCameraSimple

_CameraSimplePub_pushImage: Operation[None] = Operation(
    "RoboCompCameraSimplePub::CameraSimplePub",
    "pushImage",
    inputs=(Field("image", RoboCompCameraSimple.TImage.__contract__),),
)
CAMERASIMPLEPUB_INTERFACE = Interface(
    "RoboCompCameraSimplePub::CameraSimplePub",
    (_CameraSimplePub_pushImage,),
)


class CameraSimplePubPublisher(Proxy):
    """Publishes CameraSimplePub; waits only if its QoS is reliable."""

    interface = CAMERASIMPLEPUB_INTERFACE

    def pushImage(
        self,
        image: RoboCompCameraSimple.TImage,
        *,
        deadline: float | None = None,
    ) -> None:
        """A picture, as soon as it is taken.

        IDSL: void pushImage(RoboCompCameraSimple::TImage image)
        """
        self._send(_CameraSimplePub_pushImage, (image,), deadline)

    def loanPushImage(
        self,
        image: int | tuple[int, ...],
        *,
        deadline: float | None = None,
    ) -> AbstractContextManager[RoboCompCameraSimple.TImage]:
        """`pushImage` with an array of this shape to fill, where the message is sent
        from.

        Leaving the block sends it, unless by an exception. The array is not zeros to
        begin with, and not ours any more in the end.
        """
        return self._loan(
            _CameraSimplePub_pushImage,
            RoboCompCameraSimple.TImage,
            (image,),
            deadline,
        )
