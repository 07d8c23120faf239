"""Paths to parts of messages, as commands and scripts take them: `a.b[0]`, and for several parts `a[*].b` and `a.*`."""

from __future__ import annotations

import re
from enum import Enum

_PATH = re.compile(r"\w+(\.\w+|\[\d+\])*")
_WIDE_PATH = re.compile(r"(\w+(\.\w+|\[(\d+|\*)\])*(\.\*)?)|\*")
_STEP = re.compile(r"\[(\d+)\]|(\w+)|(\[\*\])|(\*)")


class Wide(Enum):
    """A step to several parts."""

    ITEMS = "[*]"
    """Each item of a sequence."""
    FIELDS = "*"
    """All fields of a struct; the last step of its path."""


def steps(path: str) -> list[str | int]:
    """The names and numbers of a path, in their order: `["a", "b", 0]`. Raises ValueError."""
    if not _PATH.fullmatch(path):
        raise ValueError(f"`{path}` is no path; write it as a.b, or a.b[0]")
    return [int(number) if number else name for number, name, *_ in _STEP.findall(path)]


def wide_steps(path: str) -> list[str | int | Wide]:
    """The same for a path that may name several parts. Raises ValueError."""
    if not _WIDE_PATH.fullmatch(path):
        raise ValueError(f"`{path}` is no path; write it as a.b, a[0].b, a[*].b for all items, or a.* for all fields")
    return [
        int(number) if number else name or (Wide.ITEMS if items else Wide.FIELDS)
        for number, name, items, _ in _STEP.findall(path)
    ]
