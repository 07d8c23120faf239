"""Clocks of hosts, as their components and scouts tell them."""

from __future__ import annotations

from collections.abc import Iterator

from ...contract.qos import duration
from .facts import Facts, Finding, Weight

NAME = "clocks"
HELP = "hosts whose clocks differ from this one, which makes ages of messages wrong"

_MUCH, _TOO_MUCH = 0.1, 2.0
"""Seconds."""


def find(facts: Facts) -> Iterator[Finding]:
    best: dict[str, tuple[float, float]] = {}
    for host, offset, inaccuracy in _measured(facts):
        if host not in best or inaccuracy < best[host][1]:
            best[host] = offset, inaccuracy
    for host, (offset, inaccuracy) in sorted(best.items()):
        if abs(offset) - inaccuracy > _MUCH:
            weight = Weight.ERROR if abs(offset) - inaccuracy > _TOO_MUCH else Weight.WARN
            text = f"the clock of {host} is {duration(round(abs(offset), 3))} {'ahead' if offset > 0 else 'behind'}"
            yield Finding(weight, text, "have both hosts follow one time server: timedatectl set-ntp true")


def _measured(facts: Facts) -> Iterator[tuple[str, float, float]]:
    """Hosts, each with the seconds by which its clock is ahead of ours, and by which that may be wrong."""
    for place in facts.places:
        yield place.host, place.offset, place.inaccuracy
    for each in facts.components:
        if each.description and each.offset is not None and (each.host or each.description.host != facts.host):
            yield each.host or each.description.host, each.offset, each.inaccuracy
