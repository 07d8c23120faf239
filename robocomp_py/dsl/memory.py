"""Caches the results for files that are read repeatedly, as in an editor."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar, cast

from .diagnostics import Diagnostic, Report

T = TypeVar("T")


class Memory:
    """Shared by successive workspaces of one thread. Holds one result for each key."""

    def __init__(self) -> None:
        self._kept: dict[Hashable, tuple[object, object, list[Diagnostic]]] = {}

    def recall(self, key: Hashable, given: object, make: Callable[[Report], T], report: Report) -> T:
        """The result and report of `make`, or those of the last time if the given inputs are the same.

        Bytes are compared by value. Other inputs must be the same objects, because the result refers to them.
        """
        kept = self._kept.get(key)
        if kept is None or not (kept[0] is given or (isinstance(given, bytes) and kept[0] == given)):
            found = Report()
            kept = self._kept[key] = (given, make(found), found.diagnostics)
        report.diagnostics += kept[2]
        return cast(T, kept[1])
