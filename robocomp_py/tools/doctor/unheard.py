"""Topics without subscribers."""

from __future__ import annotations

from collections.abc import Iterator

from ..drift import unheard
from .facts import Facts, Finding, Weight

NAME = "unheard"
HELP = "publishers without a subscriber"


def find(facts: Facts) -> Iterator[Finding]:
    for channel in unheard(facts.network):
        owners = ", ".join(dict.fromkeys(each.told.owner or "?" for each in channel.providers))
        text = f"{owners} publishes {channel.name}, and nothing subscribes to it"
        yield Finding(Weight.NOTE, text, f"if something should, compare the names: rc info {channel.name}")
