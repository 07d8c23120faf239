"""What every test would read anew although it stays the same: this package, its interfaces, and what is installed."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Hashable
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from robocomp_py import installed
from robocomp_py.codegen import unchanged
from robocomp_py.dsl import workspace
from robocomp_py.dsl.diagnostics import Report
from robocomp_py.dsl.memory import Memory

T = TypeVar("T")


entry_points = installed.entry_points
"""It reads them anew, as outside of tests."""


def remember() -> None:
    installed.entry_points = _remembered_entry_points
    workspace.Memory = _Remembering
    unchanged._tree = _remembered_tree


@lru_cache(8)
def _entry_points(*_folders: tuple[object, ...]) -> list[installed.EntryPoint]:
    return entry_points()


def _remembered_entry_points() -> list[installed.EntryPoint]:
    """Read again if a folder on the path has changed, or other finders are there."""
    return _entry_points(*map(_state, sys.path), tuple(map(id, sys.meta_path)))


def _state(folder: str) -> tuple[object, ...]:
    try:
        found = os.stat(folder or ".")
    except OSError:
        return (folder,)
    return folder, found.st_ino, found.st_mtime_ns


_tree = unchanged._tree
_own = lru_cache(1)(_tree)


def _remembered_tree(folder: str) -> str:
    """What stands for the files of this package, which each run of `rcgen` reads twice, 40 ms each time."""
    return (_own if folder == _PACKAGE else _tree)(folder)


_PACKAGE = str(Path(unchanged.__file__).parents[1])


class _Remembering(Memory):
    """What a workspace has that is given no memory: shipped files are parsed once, unless their bytes change."""

    def recall(self, key: Hashable, given: object, make: Callable[[Report], T], report: Report) -> T:
        path = key[1] if isinstance(key, tuple) else key
        if isinstance(path, Path) and path.parent == workspace.SHIPPED:
            return _SHIPPED.recall(key, given, make, report)
        return super().recall(key, given, make, report)


_SHIPPED = Memory()
