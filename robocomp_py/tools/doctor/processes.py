"""Processes that their launcher has trouble with."""

from __future__ import annotations

from collections.abc import Iterator

from .facts import Facts, Finding, Weight

NAME = "processes"
HELP = "processes of rcdeploy that have failed, hang or were started again"


def find(facts: Facts) -> Iterator[Finding]:
    for each in facts.launched:
        log = f"see why: rcdeploy logs {each.network} {each.name}"
        if each.is_wrong:
            how = f" ({each.how})" if each.how else ""
            yield Finding(Weight.ERROR, f"{each.name} of {each.network} is in the state {each.state}{how}", log)
        elif each.restarts:
            times = "once" if each.restarts == 1 else f"{each.restarts} times"
            yield Finding(Weight.WARN, f"{each.name} of {each.network} was started again {times}", log)
