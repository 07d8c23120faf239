"""Names that two processes use."""

from __future__ import annotations

from collections.abc import Iterator

from ...contract.interface import Pattern
from ...spelling import enumerated
from .facts import Facts, Finding, Weight

NAME = "twice"
HELP = "channels that two processes provide under one name"


def find(facts: Facts) -> Iterator[Finding]:
    told: set[tuple[str, ...]] = set()
    for channel in facts.network.channels.values():
        processes = tuple(map(str, sorted({each.process for each in channel.providers})))
        if len(processes) > 1 and (channel.instance, *processes) not in told:
            told.add((channel.instance, *processes))
            verb = "publish" if channel.pattern is Pattern.PUBLISH else "serve"
            number = "both" if len(processes) == 2 else "all"
            text = f"processes {enumerated(processes)} {number} {verb} {channel.name}"
            yield Finding(Weight.ERROR, text, "end one of them, or give it another name: --name NAME")
