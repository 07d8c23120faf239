# Generated from CameraSimplePub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompCameraSimplePub: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import Field, Interface, Operation

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
