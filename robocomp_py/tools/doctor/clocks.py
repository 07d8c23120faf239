"""Clocks of hosts, as their components tell them."""

from __future__ import annotations

from collections.abc import Iterator

from ...contract.qos import duration
from .facts import Asked, Facts, Finding, Weight

NAME = "clocks"
HELP = "hosts whose clocks differ from this one, which makes ages of messages wrong"

_MUCH, _TOO_MUCH = 0.1, 2.0
"""Seconds."""


def find(facts: Facts) -> Iterator[Finding]:
    best: dict[str, Asked] = {}
    for each in facts.components:
        if each.description and each.offset is not None and each.description.host != facts.host:
            known = best.get(each.description.host)
            if known is None or each.inaccuracy < known.inaccuracy:
                best[each.description.host] = each
    for host, each in sorted(best.items()):
        offset = each.offset or 0.0
        if abs(offset) - each.inaccuracy > _MUCH:
            weight = Weight.ERROR if abs(offset) - each.inaccuracy > _TOO_MUCH else Weight.WARN
            text = f"the clock of {host} is {duration(round(abs(offset), 3))} {'ahead' if offset > 0 else 'behind'}"
            yield Finding(weight, text, "have both hosts follow one time server: timedatectl set-ntp true")
