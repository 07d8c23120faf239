"""Converts our offsets to lines and columns of editors, which count from 0, in UTF-16 unless agreed otherwise.

Editors end lines at `\\n`, `\\r\\n` and `\\r`. They count a byte order mark at the beginning of a text, which our
sources do not contain.
"""

from __future__ import annotations

import bisect
import re
from functools import cached_property

from lsprotocol.types import Position, PositionEncodingKind, Range

from ..dsl.source import Span
from .project import BOM

_LINE_END = re.compile(r"\r\n|\n|\r")


class Positions:
    """Both directions, for one text of the editor."""

    def __init__(self, text: str, encoding: PositionEncodingKind | str = PositionEncodingKind.Utf16) -> None:
        self._shown = text
        self._shift = 1 if text.startswith(BOM) else 0
        self._width = _WIDTHS[PositionEncodingKind(encoding)]

    def position(self, offset: int) -> Position:
        shown = min(offset + self._shift, len(self._shown))
        line = bisect.bisect_right(self._starts, shown) - 1
        return Position(line, self._units(self._shown[self._starts[line] : shown]))

    def range(self, span: Span) -> Range:
        return self.between(span.start, span.end)

    def between(self, start: int, end: int) -> Range:
        return Range(self.position(start), self.position(end))

    def offset(self, position: Position) -> int:
        """The offset of a position; one beyond the end of a line or text means that end."""
        if position.line >= len(self._starts):
            return len(self._shown) - self._shift
        start = self._starts[position.line]
        end = self._starts[position.line + 1] if position.line + 1 < len(self._starts) else len(self._shown)
        line = self._shown[start:end].rstrip("\r\n")
        return max(0, start + self._characters(line, position.character) - self._shift)

    def _units(self, text: str) -> int:
        return len(text) if text.isascii() else sum(map(self._width, text))

    def _characters(self, line: str, units: int) -> int:
        if line.isascii():
            return min(units, len(line))
        for index, char in enumerate(line):
            units -= self._width(char)
            if units < 0:
                return index
        return len(line)

    @cached_property
    def _starts(self) -> list[int]:
        return [0, *(found.end() for found in _LINE_END.finditer(self._shown))]


def _utf8(char: str) -> int:
    return len(char.encode("utf-8", "replace"))


def _utf16(char: str) -> int:
    return 2 if ord(char) > 0xFFFF else 1


def _utf32(char: str) -> int:
    return 1


_WIDTHS = {
    PositionEncodingKind.Utf8: _utf8,
    PositionEncodingKind.Utf16: _utf16,
    PositionEncodingKind.Utf32: _utf32,
}
