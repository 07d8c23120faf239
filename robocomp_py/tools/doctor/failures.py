"""Calls that failed."""

from __future__ import annotations

from collections.abc import Iterator

from .facts import Facts, Finding, Weight

NAME = "failures"
HELP = "calls and handlers that failed; a declared exception is an answer"

_CALLS = "rc echo --calls --served"
"""Shows the outcomes of calls."""


def find(facts: Facts) -> Iterator[Finding]:
    for each in facts.components:
        for one in each.measures.operations if each.measures else ():
            if one.failed <= 0:
                continue
            what = {"requires": "calls of", "implements": "requests for"}.get(one.verb, "messages of")
            text = f"{each.name}: {one.failed} of {one.count} {what} {one.channel} over {one.middleware} failed"
            weight = Weight.ERROR if one.failed >= one.count else Weight.WARN
            also = f"; watch their outcomes: {_CALLS} {one.channel}" if what != "messages of" else ""
            yield Finding(weight, text, f"see why in its log: {facts.log_of(each.name)}{also}")
