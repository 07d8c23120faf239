"""Reads invalid TOML without its invalid statements, so that one pass reports all mistakes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..runtime.document import NotToml, parsed

MOST_MENDED = 10
MOST_CHARACTERS = 20_000
"""Of a longer text, only the first mistake is told: a text is read many times over to mend it."""

_FAR = 100
"""Lines that are looked at for the beginning of a statement."""

_LONG = 10
"""Lines of a statement that are looked at behind the one where it turns out to be wrong."""


@dataclass(frozen=True)
class Mended:
    """A text with spaces in place of invalid TOML, so that nothing moves, and the mistakes."""

    text: str
    errors: tuple[NotToml, ...] = ()
    removed: str = ""
    is_wrong: bool = False
    """Whether it still is, because there were too many."""

    @property
    def lacks_header(self) -> bool:
        """Whether a table's header was left out, so that the keys below it belong to no known table."""
        return bool(re.search(r"^\s*\[", self.removed, re.MULTILINE))

    def removed_name(self, name: object) -> bool:
        """Whether this word was left out."""
        return bool(re.search(rf"(?<!\w){re.escape(str(name))}(?!\w)", self.removed))


def mend(text: str, path: Path) -> Mended:
    """The text without its wrong statements. What is left may still be wrong, if there are too many."""
    errors: list[NotToml] = []
    removed: list[str] = []
    most = MOST_MENDED if len(text) <= MOST_CHARACTERS else 1
    while len(errors) < most and (error := _error(text, path)):
        errors.append(error)
        start, end = _statement(text, error, path)
        removed.append(text[start:end])
        text = _blanked(text, start, end)
    return Mended(text, tuple(errors), "\n".join(removed), _error(text, path) is not None)


def _statement(text: str, error: NotToml, path: Path) -> tuple[int, int]:
    """From where to where the statement stands that makes a text wrong here: to where another one begins."""
    starts = [0, *(found.end() for found in re.finditer("\n", text)), len(text)]
    line = _line_of(error.offset, starts)
    first = _first(text, line, starts, path)
    ends = starts[max(first + 1, line) : line + _LONG + 1]
    for end in ends:
        rest = _blanked(text, starts[first], end)
        following = _error(rest, path)
        if following is None:
            return starts[first], end
        begins = starts[_first(rest, _line_of(following.offset, starts), starts, path)]
        if begins >= end and _BEGINNING.match(text, begins):
            return starts[first], end
    return starts[first], ends[-1]


def _line_of(offset: int, starts: Sequence[int]) -> int:
    return max(number for number, start in enumerate(starts[:-1]) if start <= offset)


def _first(text: str, line: int, starts: Sequence[int], path: Path) -> int:
    """The line in which the statement begins that is found to be wrong in this one: up to there, all can be read."""
    lines = range(line, max(-1, line - _FAR), -1)
    return next((number for number in lines if not _error(text[: starts[number]], path)), line)


_BEGINNING = re.compile(r"""[ \t]*(\[\[?[ \t]*[\w"'-]|[\w"'-][\w"'. \t-]*=)""")
"""What a statement begins with."""


def _error(text: str, path: Path) -> NotToml | None:
    try:
        parsed(text, path)
    except NotToml as exc:
        return exc
    return None


def _blanked(text: str, start: int, end: int) -> str:
    return text[:start] + re.sub(r"[^\n]", " ", text[start:end]) + text[end:]
