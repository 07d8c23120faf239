"""What a network declares, beside what runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..drift import Drift, Presence, Use, compare
from ..network import TOOL
from .facts import Facts, Finding, Weight

NAME = "plan"
HELP = "what a network declares and does not run or connect, and what is connected and not declared"


def find(facts: Facts) -> Iterator[Finding]:
    for plan in facts.plans:
        try:
            drift = compare(plan, facts.network, facts.tellers)
        except ValueError as exc:
            yield Finding(Weight.WARN, str(exc), "start the network again, or give rc doctor its DDSL file")
        else:
            ended = _ended(plan, facts)
            yield from dict.fromkeys((*_missing(drift, ended), *_unconnected(drift), *_undeclared(drift)))


def _ended(plan: Mapping[str, Any], facts: Facts) -> dict[str, str]:
    """How those instances ended that have done their work, or that the user has stopped."""
    how = {each.name: each.how for each in facts.launched if (each.network, each.state) == (plan["name"], "ended")}
    runs_in = {str(name): str(each.get("name", "")) for each in plan["processes"] for name in each["instances"]}
    return {name: how[process] for name, process in runs_in.items() if process in how}


def _missing(drift: Drift, ended: Mapping[str, str]) -> Iterator[Finding]:
    for each in drift.instances:
        if each.presence is not Presence.MISSING:
            continue
        uses = dict.fromkeys(_used(use) for use in drift.uses if use.client == each.name)
        what = f"is declared to use {', '.join(uses)}, and" if uses else f"is declared in {drift.network}, and"
        if each.name in ended:
            text = f"{each.name} {what} {ended[each.name] or 'has ended'}"
            yield Finding(Weight.NOTE, text, f"to start it again: rcdeploy start {drift.network} {each.name}")
        else:
            log = f"rcdeploy logs {drift.network} {each.name}"
            yield Finding(Weight.ERROR, f"{each.name} {what} is not there", log)


def _unconnected(drift: Drift) -> Iterator[Finding]:
    told: set[tuple[str, str]] = set()
    for use in drift.uses_of(Presence.MISSING):
        ends = {drift.presence_of(use.client), drift.presence_of(use.provider)}
        if ends == {Presence.PRESENT} and (use.client, _used(use)) not in told:
            told.add((use.client, _used(use)))
            text = f"{use.client} is declared to use {_used(use)}, and is not connected to it"
            advice = f"rcdeploy restart {drift.network} {use.client}; see: rc info {use.channel}"
            yield Finding(Weight.ERROR, text, advice)


def _undeclared(drift: Drift) -> Iterator[Finding]:
    for use in drift.uses_of(Presence.UNDECLARED):
        weight = Weight.NOTE if use.owner == TOOL else Weight.WARN
        text = f"{use.client} uses {_used(use)}, which {drift.network} does not declare"
        yield Finding(weight, text, "declare it in the DDSL file, or end it if nothing needs it")


def _used(use: Use) -> str:
    return f"{use.interface} of {use.provider}"
