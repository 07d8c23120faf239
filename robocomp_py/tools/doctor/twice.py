"""Names that two processes use."""

from __future__ import annotations

from collections.abc import Iterator

from ...contract.interface import Pattern
from .facts import Facts, Finding, Weight

NAME = "twice"
HELP = "channels that two processes provide under one name"


def find(facts: Facts) -> Iterator[Finding]:
    told: set[tuple[str, ...]] = set()
    for channel in facts.network.channels.values():
        pids = tuple(sorted({each.told.pid for each in channel.providers}))
        if len(pids) > 1 and (channel.instance, *map(str, pids)) not in told:
            told.add((channel.instance, *map(str, pids)))
            listed = " and ".join(map(str, pids))
            verb = "publish" if channel.pattern is Pattern.PUBLISH else "serve"
            text = f"processes {listed} both {verb} {channel.name}"
            yield Finding(Weight.ERROR, text, "end one of them, or give it another name: --name NAME")
