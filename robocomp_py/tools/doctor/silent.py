"""Components that do not answer."""

from __future__ import annotations

from collections.abc import Iterator

from .facts import Facts, Finding, Weight

NAME = "silent"
HELP = "components that are there and do not answer, for example because they are stopped"

_STOPPED = ("T", "t")
"""States of a process in Linux: by a signal, or by a debugger."""


def find(facts: Facts) -> Iterator[Finding]:
    for each in facts.components:
        if each.description is not None or not each.pid:
            continue
        if each.state in _STOPPED:
            text = f"{each.name} does not answer, since its process {each.pid} is stopped"
            yield Finding(Weight.ERROR, text, f"let it go on: kill -CONT {each.pid}", each.host)
        else:
            text = f"{each.name} (process {each.pid}) does not answer"
            stacks = f"kill -ABRT {each.pid} ends it with its stacks"
            yield Finding(Weight.ERROR, text, f"see its log: {facts.log_of(each.name)}; {stacks}", each.host)
