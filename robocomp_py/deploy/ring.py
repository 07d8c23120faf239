"""What the processes of a network printed last, in memory. Bounded for each: who prints much pushes out nobody else."""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

LINES, CHARACTERS = 1000, 65536
"""How much is kept of each."""

Sink = Callable[[str, str], None]


@dataclass
class _Kept:
    lines: deque[tuple[int, str, str]] = field(default_factory=deque)
    """With the number of the line among all, and the name."""
    characters: int = 0


class Ring:
    def __init__(self) -> None:
        self._kept: dict[str, _Kept] = {}
        self._numbers = itertools.count()
        self._sinks: list[Sink] = []

    def write(self, name: str, text: str) -> None:
        kept = self._kept.setdefault(name, _Kept())
        kept.lines.append((next(self._numbers), name, text))
        kept.characters += len(text)
        while len(kept.lines) > LINES or (kept.characters > CHARACTERS and len(kept.lines) > 1):
            kept.characters -= len(kept.lines.popleft()[2])
        for sink in self._sinks:
            sink(name, text)

    def last(self, names: Collection[str], count: int) -> list[tuple[str, str]]:
        """The newest lines of these (of all, if none is named), with their names, the oldest first."""
        chosen = [kept.lines for name, kept in self._kept.items() if not names or name in names]
        newest = heapq.nlargest(count, itertools.chain.from_iterable(chosen))
        return [(name, text) for _, name, text in reversed(newest)]

    def follow(self, sink: Sink) -> Callable[[], None]:
        """Have each line told from now on, with its name. Returns what ends that."""
        self._sinks.append(sink)
        return lambda: self._sinks.remove(sink)
