# Generated from camera.cdsl by rcgen 0.1.0: edits are lost.
"""What a test of camera may fake, for ComponentTest: by port, then by operation."""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake


class CameraSimplePubFakes(TypedDict, total=False):
    """What the other side of `camerasimplepub` does."""

    pushImage: Fake[None]


class Fakes(TypedDict, total=False):
    """The other sides of all ports."""

    camerasimplepub: CameraSimplePubFakes
