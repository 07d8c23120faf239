"""Finds the places of keys and values in a TOML text, which `tomllib` does not report.

The text must be valid: parse it with `tomllib` first.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass

Key = tuple[str | int, ...]
Range = tuple[int, int]
"""Offsets of the first character and of the end."""


@dataclass(frozen=True, slots=True)
class Spot:
    """The places of a key and of its value. Of a dotted key, the place of the last part; of a table, its header."""

    key: Range
    value: Range


def locate(text: str) -> dict[Key, Spot]:
    """The place of every key, item and table of a text. A table that is written in parts has the place of the first."""
    scanner = _Scanner(text)
    scanner.document()
    return scanner.spots


class _Scanner:
    def __init__(self, text: str) -> None:
        self._text, self._at = text, 0
        self._items: dict[Key, int] = {}
        """The number of the last item of each array of tables."""
        self.spots: dict[Key, Spot] = {}

    def document(self) -> None:
        table: Key = ()
        while self._skip():
            if self._text[self._at] == "[":
                table = self._header()
            else:
                self._pair(table)

    def _header(self) -> Key:
        start = self._at
        is_item = self._text.startswith("[[", start)
        self._at += 1 + is_item
        names = self._names()
        self._skip_spaces()
        self._at += 1 + is_item
        here = (start, self._at)
        key: Key = ()
        for number, (name, place) in enumerate(names, 1):
            key = (*key, name)
            if is_item and number == len(names):
                self._items[key] = self._items.get(key, -1) + 1
            self.spots.setdefault(key, Spot(place, here))
            if key in self._items:
                key = (*key, self._items[key])
                self.spots.setdefault(key, Spot(place, here))
        return key

    def _pair(self, table: Key) -> None:
        names = self._names()
        self._skip_spaces()
        self._at += 1  # the equals sign
        self._skip_spaces()
        key: Key = (*table, *(name for name, _ in names))
        value = self._value(key)
        for length, (_, place) in enumerate(names, len(table) + 1):
            self.spots.setdefault(key[:length], Spot(place, value))

    def _names(self) -> list[tuple[str, Range]]:
        names = []
        while True:
            self._skip_spaces()
            start = self._at
            name = self._match(_NAME)
            end = self._at
            names.append((tomllib.loads(f"x = {name}")["x"] if name[0] in "\"'" else name, (start, end)))
            self._skip_spaces()
            if self._text[self._at : self._at + 1] != ".":
                self._at = end
                return names
            self._at += 1

    def _value(self, key: Key) -> Range:
        start = self._at
        match self._text[start]:
            case "[":
                self._array(key)
            case "{":
                self._inline_table(key)
            case _:
                self._at = start + len(self._match(_SCALAR).rstrip())
        return start, self._at

    def _array(self, key: Key) -> None:
        self._at += 1
        number = 0
        while self._skip() and self._text[self._at] != "]":
            item = self._value((*key, number))
            self.spots[(*key, number)] = Spot(item, item)
            number += 1
            self._skip()
            self._at += self._text[self._at] == ","
        self._at += 1

    def _inline_table(self, key: Key) -> None:
        self._at += 1
        while self._skip() and self._text[self._at] != "}":
            self._pair(key)
            self._skip()
            self._at += self._text[self._at] == ","
        self._at += 1

    def _skip(self) -> bool:
        """Skip white space and comments. Returns False at the end of the text."""
        self._match(_NOTHING)
        return self._at < len(self._text)

    def _skip_spaces(self) -> None:
        self._match(_SPACES)

    def _match(self, pattern: re.Pattern[str]) -> str:
        found = pattern.match(self._text, self._at)
        assert found, "a text that tomllib has read"
        self._at = found.end()
        return found[0]


_NOTHING = re.compile(r"(?:\s|#[^\n]*)*")
_SPACES = re.compile(r"[ \t]*")
_NAME = re.compile(r"""[A-Za-z0-9_-]+|"(?:\\.|[^"\\\n])*"|'[^'\n]*'""")
_SCALAR = re.compile(
    r'''"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?'{3,5}|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|[^,\]}#\n]+''', re.DOTALL
)
