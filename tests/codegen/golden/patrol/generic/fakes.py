# Generated from patrol.cdsl by rcgen 0.1.0: edits are lost.
"""What a test of patrol may fake, for ComponentTest: by port, then by operation."""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake


class DrawingFakes(TypedDict, total=False):
    """What the other side of `drawing` does."""

    draw: Fake[None]


class Fakes(TypedDict, total=False):
    """The other sides of all ports."""

    drawing: DrawingFakes
