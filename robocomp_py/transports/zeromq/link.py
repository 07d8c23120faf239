"""The base of publishers in this transport."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..directory_transport import DirectoryLink

if TYPE_CHECKING:
    from .transport import ZeroMQTransport  # noqa: F401  # named below, in quotes

TICK = 0.05
"""Seconds between two looks at awaited peers, and into the directory if its changes are not reported."""


class Link(DirectoryLink["ZeroMQTransport"]):
    """One end of a channel of this transport."""
