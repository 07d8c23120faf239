"""Free shared memory."""

from __future__ import annotations

from collections.abc import Iterator

from .facts import Facts, Finding, Weight, size

NAME = "memory"
HELP = "the space in shared memory"

_NOTHING, _LITTLE = 8 << 20, 64 << 20
"""Octets: what one more component may need, and what several do."""


def find(facts: Facts) -> Iterator[Finding]:
    memory = facts.machine.memory
    if missing := facts.machine.missing_memory:
        text = f"there is no shared memory at {missing}, so components cannot use it"
        yield Finding(Weight.WARN, text, f"sudo mount -t tmpfs tmpfs {missing}")
    if memory and memory.free < min(_LITTLE, memory.size // 2):
        weight = Weight.ERROR if memory.free < _NOTHING else Weight.WARN
        text = f"{memory.path} has {size(memory.free)} of {size(memory.size)} left for messages in shared memory"
        larger = f"sudo mount -o remount,size={max(1, 2 * memory.size >> 30)}G {memory.path}"
        yield Finding(weight, text, f"remove what is not used there, or enlarge it: {larger}")
