"""Names in sentences: what may have been meant by a misspelt one, and lists of several."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def closest(name: str, known: Iterable[str], *, prefix: str = "") -> str:
    """The known name closest to `name`, or "" if none is close. `prefix` is ignored in the comparison.

    A name with which a single known one begins means that, if less than half of it is missing. Case counts only between
    names that differ in nothing else.
    """
    import difflib  # most commands have nothing misspelt

    spellings: dict[str, list[str]] = {}
    for each in known:
        spellings.setdefault(each.removeprefix(prefix).lower(), []).append(each)
    meant = name.removeprefix(prefix).lower()
    likeness = _SHORT_LIKENESS if len(meant) <= _SHORT else _LIKENESS
    begun = [each for each in spellings if each.startswith(meant) and len(each) < 2 * len(meant)]
    close = begun if len(begun) == 1 else difflib.get_close_matches(meant, spellings, 1, cutoff=likeness)
    return difflib.get_close_matches(name, spellings[close[0]], 1, cutoff=0)[0] if close else ""


_LIKENESS = 0.7
_SHORT, _SHORT_LIKENESS = 3, 0.66
"""Of three characters, one may be wrong."""


def unknown(what: str, name: str, known: Iterable[str]) -> str:
    """`unknown parameter `max_sped`; did you mean `max_speed`?`, or all there are if none is close."""
    names = list(known)
    near = closest(name, names)
    return f"unknown {what} `{name}`; " + (
        f"did you mean `{near}`?" if near else f"known: {', '.join(names) or 'none'}"
    )


def beside(path: Path) -> Path | None:
    """What the folder of a missing file or folder has under a similar name with the same ending, if anything."""
    try:
        names = [each.name for each in path.parent.iterdir() if each.suffix == path.suffix]
    except (OSError, ValueError):  # no folder, or a name that cannot be one
        return None
    near = closest(path.name, names)
    return path.with_name(near) if near else None


def and_then(first: str, more: str) -> str:
    """Two parts of a message: `a; b`, and after a question `a? b`."""
    return f"{first}{' ' if first.endswith('?') else '; '}{more}"


def enumerated(names: Iterable[str]) -> str:
    """`a, b and c`."""
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last
