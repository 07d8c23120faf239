"""Errors in the logs of components."""

from __future__ import annotations

from collections.abc import Iterator

from .facts import Facts, Finding, Weight

NAME = "logs"
HELP = "components under rcdeploy that have logged errors since their start"

_LONGEST = 200
"""Characters of an error that are shown."""


def find(facts: Facts) -> Iterator[Finding]:
    for each in facts.complaints:
        errors = "an error" if each.count == 1 else f"{each.count} errors"
        text = f"{each.instance} has logged {errors}, the newest: {_brief(each.newest)}"
        yield Finding(Weight.ERROR, text, f"rcdeploy logs {each.network} {each.name} --level error")


def _brief(text: str) -> str:
    """The first line, and the last one of a traceback, which says what was raised."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    raised = [line for line in lines[1:] if not line.startswith("(and ")]
    shown = f"{_unnamed(lines[0], raised[-1])}: {raised[-1]}" if raised else lines[0] if lines else "?"
    return shown if len(shown) <= _LONGEST else f"{shown[:_LONGEST]}…"


def _unnamed(first: str, last: str) -> str:
    """A first line without the exception's name, if the last line of the traceback begins with it."""
    name = last.partition(":")[0].rpartition(".")[2]
    return first.removesuffix(f" {name}") if first.endswith(f" raised {name}") else first
