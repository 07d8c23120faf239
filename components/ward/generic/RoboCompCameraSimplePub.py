# Generated from CameraSimplePub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompCameraSimplePub: types, interfaces and proxies."""

from __future__ import annotations

from contextlib import AbstractContextManager

from robocomp_py.runtime.api import Field, Interface, Operation, Proxy

from . import RoboCompCameraSimple

_CameraSimplePub_pushImage: Operation[None] = Operation(
    "RoboCompCameraSimplePub::CameraSimplePub",
    "pushImage",
    inputs=(Field("image", RoboCompCameraSimple.TImage.__contract__),),
    doc="A picture, as soon as it is taken.",
)
CAMERASIMPLEPUB_INTERFACE = Interface(
    "RoboCompCameraSimplePub::CameraSimplePub",
    (_CameraSimplePub_pushImage,),
)


class CameraSimplePubPublisher(Proxy):
    """Publishes CameraSimplePub. A call waits only if its QoS is reliable."""

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
        """`pushImage` with an array of this shape, to be filled in the memory that is
        sent.

        The message is sent at the end of the `with` block, unless it raises. The array
        must be filled completely, and must not be used after the block.
        """
        return self._loan(
            _CameraSimplePub_pushImage,
            RoboCompCameraSimple.TImage,
            (image,),
            deadline,
        )
