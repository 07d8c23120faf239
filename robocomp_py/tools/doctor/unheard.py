"""Topics without subscribers."""

from __future__ import annotations

from collections.abc import Iterator

from ...contract.interface import Pattern
from ..actions import offered
from .facts import Facts, Finding, Weight

NAME = "unheard"
HELP = "publishers without a subscriber"


def find(facts: Facts) -> Iterator[Finding]:
    parts = {part.name for each in offered(facts.network).values() for part in each.parts.values()}
    for channel in facts.network.channels.values():
        is_topic = channel.pattern is Pattern.PUBLISH and channel.name not in parts  # an action may have no client now
        if is_topic and channel.providers and not channel.users:
            owners = ", ".join(dict.fromkeys(each.told.owner or "?" for each in channel.providers))
            text = f"{owners} publishes {channel.name}, and nothing subscribes to it"
            yield Finding(Weight.NOTE, text, f"if something should, compare the names: rc info {channel.name}")
