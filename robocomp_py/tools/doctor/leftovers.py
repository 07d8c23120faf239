"""What killed processes have left."""

from __future__ import annotations

from collections.abc import Iterator

from .facts import Facts, Finding, Weight

NAME = "leftovers"
HELP = "directory entries, sockets and shared memory of killed processes, and networks whose launcher was killed"


def find(facts: Facts) -> Iterator[Finding]:
    for name in facts.killed_networks:
        text = f"the rcdeploy that ran {name} was killed, and its components may still run"
        yield Finding(Weight.ERROR, text, f"end them, and begin anew: rcdeploy up {name}.ddsl")
    for each in facts.left:
        if each.dead:
            entries = "1 entry or socket" if each.dead == 1 else f"{each.dead} entries or sockets"
            text = f"killed processes have left {entries} of {each.middleware}"
            yield Finding(Weight.WARN, text, f"none is in use; the next component over {each.middleware} removes them")
        if each.memory:
            files = "1 file" if each.memory == 1 else f"{each.memory} files"
            text = f"killed processes have left {files} of {each.middleware} in shared memory"
            yield Finding(Weight.WARN, text, f"the next component over {each.middleware} removes them")
