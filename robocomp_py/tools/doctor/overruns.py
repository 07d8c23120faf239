"""Components that take longer than their period."""

from __future__ import annotations

from collections.abc import Iterator

from ...contract.qos import duration
from ...runtime.RoboCompIntrospection import Measures
from .facts import Facts, Finding, Weight

NAME = "overruns"
HELP = "components whose compute or timers take longer than their period"

_SOME, _MANY = 0.01, 0.2
"""Of all periods."""

_HANDLED = ("implements", "subscribesTo")

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
            yield Finding(
                weight, text, f"make its compute{_handler(measures)} faster, or its period longer: component.period"
            )


def _handler(measures: Measures) -> str:
    """The slowest handler, if it alone takes half a period: meanwhile `compute` and timers have to wait."""
    handlers = (each for each in measures.operations if each.verb in _HANDLED and len(each.latest))
    took, name = max(((max(each.latest), f"{each.port}_{each.operation}") for each in handlers), default=(0.0, ""))
    return f" and its handler {name} (up to {took:.2g} s)" if took >= measures.period / 2 else ""
