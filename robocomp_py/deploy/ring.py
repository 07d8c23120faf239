"""The last lines that the processes of a network printed, in memory. Each process has its own bound."""

from __future__ import annotations

import heapq
import itertools
import re
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import NamedTuple

from ..runtime import records
from ..runtime.records import Record

LINES, CHARACTERS = 1000, 65536
"""The most lines and characters that are kept of each process."""


MOST_LINES = 10000
"""Lines of the past that a client is told."""

_LEVEL = re.compile(f"({'|'.join(records.LEVELS)}): ")


class Line(NamedTuple):
    """A line that a process printed, or a record that it logged, whose text may have several lines."""

    at: float
    """The time of its arrival, in seconds since the Unix epoch."""
    name: str
    text: str
    """As people read it; of a record with its level, and with its instance if the process has another name."""
    record: Record | None = None

    @property
    def level(self) -> str:
        """One of `records.LEVELS`; "" if it was printed."""
        if self.record:
            return self.record.level
        found = _LEVEL.match(self.text)
        return found[1] if found else ""

    @property
    def message(self) -> str:
        """Its text without level and instance."""
        if self.record:
            return self.record.text
        return self.text.removeprefix(f"{self.level}: ") if self.level else self.text


def printed(at: float, name: str, written: str) -> Line:
    """What came through the pipe of a process."""
    record = records.read(written)
    if record is None:
        return Line(at, name, written)
    whose = f"{record.instance}: " if record.instance not in ("", name) else ""
    return Line(at, name, f"{record.level}: {whose}{record.text}", record)


Sink = Callable[[Line], None]


@dataclass
class _Kept:
    lines: deque[tuple[int, Line]] = field(default_factory=deque)
    """Each with its number among the lines of all processes."""
    characters: int = 0


class Ring:
    def __init__(self) -> None:
        self._kept: dict[str, _Kept] = {}
        self._numbers = itertools.count()
        self._sinks: list[Sink] = []

    def write(self, line: Line) -> None:
        kept = self._kept.setdefault(line.name, _Kept())
        kept.lines.append((next(self._numbers), line))
        kept.characters += len(line.text)
        while len(kept.lines) > LINES or (kept.characters > CHARACTERS and len(kept.lines) > 1):
            kept.characters -= len(kept.lines.popleft()[1].text)
        for sink in self._sinks:
            sink(line)

    def last(self, names: Collection[str], count: int) -> list[Line]:
        """The newest lines of these processes (of all, if none is named), the oldest first."""
        chosen = [kept.lines for name, kept in self._kept.items() if not names or name in names]
        newest = heapq.nlargest(count, itertools.chain.from_iterable(chosen))
        return [line for _, line in reversed(newest)]

    def follow(self, sink: Sink) -> Callable[[], None]:
        """Call `sink` with each new line. Returns a function that ends this."""
        self._sinks.append(sink)
        return lambda: self._sinks.remove(sink)
