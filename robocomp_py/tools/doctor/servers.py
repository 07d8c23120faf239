"""Calls and subscriptions that nothing answers."""

from __future__ import annotations

from collections.abc import Iterator

from ...contract.interface import Pattern
from ...wire import names
from ..network import PATTERNS
from .facts import Facts, Finding, Weight

NAME = "servers"
HELP = "clients whose server is not there, and subscribers whose publisher is not there"


def find(facts: Facts) -> Iterator[Finding]:
    told: set[str] = set()
    for end in facts.network.ends:
        pattern = PATTERNS[end.role]
        if end.provides or _is_provided(facts, end.told.channel, pattern):
            continue
        if pattern is Pattern.PUBLISH and "-" in end.told.channel.rpartition("/")[2]:
            continue  # the feedback of an action, which is served with its queries
        instance, interface = names.instance(end.told.channel), names.segment(end.told.channel)
        whose = interface if instance == names.ANY else f"{interface} of {instance}"
        does, weight = ("subscribes to", Weight.WARN) if pattern is Pattern.PUBLISH else ("uses", Weight.ERROR)
        text = f"{end.told.owner or '?'} {does} {whose}, and nothing there provides it"
        if text not in told:
            told.add(text)
            if instance == names.ANY:
                advice = f"start a component that provides {interface}"
            else:
                whole = end.told.channel.rsplit("/", 2)[0]
                advice = f"start {instance}, or see why it ended: {facts.log_of(whole)}"
            yield Finding(weight, text, advice)


def _is_provided(facts: Facts, wanted: str, pattern: Pattern) -> bool:
    every = facts.network.channels.values()
    return any(each.providers and each.pattern is pattern and names.matches(wanted, each.name) for each in every)
