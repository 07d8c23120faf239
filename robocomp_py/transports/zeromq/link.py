"""What all ends of channels have in common here: they are announced, and look at those they wait for, so often."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..directory_transport import DirectoryLink

if TYPE_CHECKING:
    from .transport import ZeroMQTransport  # noqa: F401  # named below, in quotes

TICK = 0.05
"""Seconds between two looks at those we wait for, and into the directory if nobody tells when it changes."""


class Link(DirectoryLink["ZeroMQTransport"]):
    """One end of a channel of this transport."""
