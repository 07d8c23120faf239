"""Components that take longer than their period."""

from __future__ import annotations

from collections.abc import Iterator

from ...contract.qos import duration
from .facts import Facts, Finding, Weight

NAME = "overruns"
HELP = "components whose compute or timers take longer than their period"

_SOME, _MANY = 0.01, 0.2
"""Of all periods."""

_LEAST = 5
"""Fewer happen while a component starts."""


def find(facts: Facts) -> Iterator[Finding]:
    for each in facts.components:
        measures = each.measures
        if measures is None or measures.overruns < _LEAST:
            continue
        share = measures.overruns / (measures.overruns + max(0, measures.computes))
        if share >= _SOME:
            weight = Weight.ERROR if share >= _MANY else Weight.WARN
            period = duration(measures.period)
            text = f"{each.name} left out {share:.0%} of its periods of {period} ({measures.overruns} since its start)"
            yield Finding(weight, text, "make its compute faster, or its period longer: component.period")
