"""Makes printed text of components safe for terminals and files."""

from __future__ import annotations

import re
from itertools import islice

_MOVES = re.compile(r"\x1b(?!\[[0-9;:]*m)|[\x00-\x08\x0b-\x1a\x1c-\x1f\x7f-\x9f]")
"""Characters that move the cursor, or control the terminal in other ways. Sequences that set colours are not meant."""

_REORDERS = re.compile("[\u2028-\u202e\u2066-\u2069]")
"""Separators of lines, and characters that change the order in which a terminal shows the others."""

_COLOURS = re.compile(r"\x1b\[([0-9;:]*)m")
_RESET = "\x1b[0m"
_CONCEAL = 8
_EXTENDED = ("38", "48", "58")
"""Parameters that the numbers of a colour follow: of the foreground, the background, and underlines."""


def harmless(text: str) -> str:
    """For a terminal: with its colours, reset at the end, but without anything that hides or moves text."""
    if text.isprintable():
        return text
    shown = _COLOURS.sub(_visible, _without_control(text))
    colours = _COLOURS.findall(shown)
    return shown + _RESET if colours and colours[-1] not in ("", "0") else shown


def plain(text: str) -> str:
    """For a file: without any control sequences."""
    return text if text.isprintable() else _COLOURS.sub("", _without_control(text))


def _without_control(text: str) -> str:
    return _REORDERS.sub(lambda found: f"\\u{ord(found[0]):04x}", _MOVES.sub("", text))


def _visible(found: re.Match[str]) -> str:
    """A sequence of colours without the parameter that conceals text."""
    given = iter(found[1].split(";"))
    kept: list[str] = []
    for each in given:
        if each in _EXTENDED:
            space = next(given, "")
            kept += [each, space, *islice(given, 3 if space == "2" else 1)]
        elif not each.isdecimal() or int(each) != _CONCEAL:
            kept.append(each)
    return f"\x1b[{';'.join(kept)}m" if kept else ""
