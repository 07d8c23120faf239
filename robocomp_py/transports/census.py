"""What processes announce to others, for tools."""

from __future__ import annotations

from typing import NamedTuple


class Told(NamedTuple):
    """One end of a channel, as its process announces it. All of it comes from outside."""

    owner: str
    """The component, or another program; it may be empty."""
    pid: int
    role: str
    """`publishes`, `subscribes`, `commands`, `receives`, `calls` or `serves`."""
    channel: str
    fingerprint: int
    text: str
    """Its contract; it may be empty."""
    traits: str = ""
    """The QoS that a publisher offers or a subscriber asks for, as `contract.qos.traits` writes it."""
