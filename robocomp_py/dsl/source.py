"""Texts, and places in them."""

from __future__ import annotations

import bisect
import re
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path


@dataclass(frozen=True)
class Source:
    """A file's text. Offsets count characters; lines and columns count from 1."""

    path: Path
    text: str = field(repr=False)
    has_places: bool = True
    """False for a file that could not be read, or is not a file: diagnostics name only its path."""

    def position(self, offset: int) -> tuple[int, int]:
        line = bisect.bisect_right(self._starts, offset)
        return line, offset - self._starts[line - 1] + 1

    def offset(self, line: int, column: int) -> int:
        """The offset of a line and column."""
        return min(self._starts[line - 1] + column, len(self.text))

    def line(self, number: int) -> str:
        """The text of a line, without its end."""
        start = self._starts[number - 1]
        end = self._starts[number] if number < len(self._starts) else len(self.text)
        return self.text[start:end].rstrip("\r\n")

    def span(self, start: int, end: int) -> Span:
        return Span(self, start, max(start, end))

    @cached_property
    def _starts(self) -> list[int]:
        return [0, *(found.end() for found in re.finditer("\n", self.text))]


@dataclass(frozen=True, slots=True)
class Span:
    """From `start` to before `end`."""

    source: Source = field(repr=False)
    start: int
    end: int

    @property
    def text(self) -> str:
        return self.source.text[self.start : self.end]

    def touches(self, offset: int) -> bool:
        """Whether an offset is in it, or just behind it, as the cursor of an editor may be."""
        return self.start <= offset <= self.end

    def to(self, other: Span) -> Span:
        """From here to the end of the other."""
        return Span(self.source, self.start, max(self.end, other.end))


@dataclass(frozen=True, slots=True)
class Name:
    """A word of a file, and where it stands."""

    text: str
    span: Span

    def __str__(self) -> str:
        return self.text
