"""Caches the results for files that are read repeatedly, as in an editor."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar, cast

from .diagnostics import Diagnostic, Report

T = TypeVar("T")


class Memory:
    """Shared by workspaces that follow one another, in one thread. Holds one result for each key."""

    def __init__(self) -> None:
        self._kept: dict[Hashable, tuple[object, object, list[Diagnostic]]] = {}

    def recall(self, key: Hashable, given: object, make: Callable[[Report], T], report: Report) -> T:
        """What `make` comes to, and reports, for something given: as the last time, if that was the same.

        Bytes are the same if they are equal. All else has to be the very same: what was made of it refers to it.
        """
        kept = self._kept.get(key)
        if kept is None or not (kept[0] is given or (isinstance(given, bytes) and kept[0] == given)):
            found = Report()
            kept = self._kept[key] = (given, make(found), found.diagnostics)
        report.diagnostics += kept[2]
        return cast(T, kept[1])
