"""The files that the editor has open, and the files around them: reads, checks and finds them.

Every check uses a new workspace with a shared memory, so that unchanged files are not parsed again.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import TypeVar

from .. import installed
from ..dsl.diagnostics import Diagnostic, Report, ordered
from ..dsl.innermodel.check import ENDING, declared_encoding, is_root
from ..dsl.memory import Memory
from ..dsl.workspace import ENDINGS, Workspace, read_file
from ..usercode.check import check_component, check_network
from .outline import Outline

BOM = "\ufeff"

MAX_FILES = 5000
"""The most models that are searched for in the folders of a project."""

MAX_FOLDERS = 20_000

_PASSED_OVER = ("node_modules", "__pycache__", "site-packages", "build", "dist")


G = TypeVar("G")
M = TypeVar("M")


@dataclass
class Buffer:
    """A file with the editor's text and URI."""

    path: Path
    text: str
    version: int | None = None
    uri: str = ""


class Project:
    """Folders, include folders, and open files. The disk is read through `read`, which prefers the open ones."""

    def __init__(self, folders: Sequence[Path] = (), include: Sequence[Path] = ()) -> None:
        self.folders, self.include = list(folders), list(include)
        self._buffers: dict[str, Buffer] = {}
        self._memory = Memory()
        self._middlewares = list(installed.transports())
        self._scanned: dict[str, Path] | None = None
        self.last_outlines: dict[str, Outline] = {}
        """The last readable outlines of files: names that can be completed while a file has errors."""
        self._used: dict[str, set[str]] = {}
        """The files that were read, or searched for without success, to check an open file."""

    # Open files.

    def open(self, path: Path, text: str, version: int | None = None, uri: str = "") -> None:
        """The editor opened a file, or changed its text."""
        if not self.folders and real(path) not in self._buffers:
            self._scanned = None  # the files beside it belong to the project now
        self._buffers[real(path)] = Buffer(path, text, version, uri)

    def close(self, path: Path) -> None:
        self._buffers.pop(real(path), None)
        self._used.pop(real(path), None)

    def buffer(self, path: Path) -> Buffer | None:
        return self._buffers.get(real(path))

    @property
    def opened(self) -> list[Path]:
        return [each.path for each in self._buffers.values()]

    @property
    def versions(self) -> dict[str, int | None]:
        """The versions of open files, by their real names."""
        return {key: each.version for key, each in self._buffers.items()}

    def forget_disk(self) -> None:
        """Note files that were created, removed or changed outside the editor."""
        self._scanned = None
        real.cache_clear()

    # Reading.

    def read(self, path: Path) -> bytes:
        """A file's bytes: those of the editor if it is open, otherwise those of the disk."""
        buffer = self._buffers.get(real(path))
        return buffer.text.encode(_encoding(buffer), "replace") if buffer else read_file(path)

    def text(self, path: Path) -> str:
        """The text of a file as an editor shows it; "" if it cannot be read."""
        buffer = self.buffer(path)
        if buffer:
            return buffer.text
        source = self.workspace().source(path)
        return source.text if source else ""

    def workspace(self) -> Workspace:
        return Workspace(self.include, self.read, self._middlewares, self._memory)

    def remembered(self, make: Callable[[G], M], path: Path, given: G) -> M:
        """The result of `make` for a file's model, computed once for each."""
        return self._memory.recall((make, path), given, lambda report: make(given), Report())

    def with_texts(self, texts: Iterable[tuple[Path, str]]) -> Project:
        """A copy of this project with other texts."""
        other = Project(self.folders, self.include)
        other._buffers = dict(self._buffers)
        other._scanned = self._scanned
        other._memory = self._memory
        for path, text in texts:
            other.open(path, text)
        return other

    # Checking.

    def check(self, path: Path) -> list[Diagnostic]:
        """The diagnostics of a file and its imports, like those of `rc lint`."""
        used: set[str] = set()

        def read(asked: Path) -> bytes:
            used.add(real(asked))
            return self.read(asked)

        workspace = Workspace(self.include, read, self._middlewares, self._memory)
        report = _checked(path, workspace)
        if real(path) in self._buffers:
            self._used[real(path)] = used
        return ordered(report.diagnostics)

    def dependents(self, path: Path) -> list[Path]:
        """The other open files that depend on this one."""
        changed = real(path)
        found = (self._buffers[each] for each, used in self._used.items() if changed in used and each != changed)
        return [buffer.path for buffer in found]

    # Finding.

    def files(self) -> list[Path]:
        """Every model of the project: in its folders, or beside an open file; open ones come first."""
        if self._scanned is None:
            folders = self.folders or sorted({each.parent for each in self.opened})
            found = islice(_scan(folders, deep=bool(self.folders)), MAX_FILES)
            self._scanned = {real(each): each for each in found}
        opened = {key: buffer.path for key, buffer in self._buffers.items()}
        return list({**opened, **self._scanned, **opened}.values())

    def owns(self, path: Path) -> bool:
        """Whether a file is the user's: open, or in a folder of the project."""
        where = real(path)
        return where in self._buffers or any(where.startswith(real(each) + os.sep) for each in self.folders)


@lru_cache(maxsize=4 * MAX_FILES)
def real(path: Path) -> str:
    """One name for a file, for all paths that lead to it."""
    return os.path.realpath(path)


def without_mark(text: str) -> str:
    """A text without a byte order mark."""
    return text.removeprefix(BOM)


def _checked(path: Path, workspace: Workspace) -> Report:
    match path.suffix.lower():
        case ".ddsl":
            return _check_network(path, workspace)
        case ".toml":
            _check_configuration(path, workspace)
        case ".xml":
            if is_root(workspace.read(path).decode("utf-8", "replace")):
                workspace.check(path)
        case ".cdsl":
            workspace.check(path)
            check_component(path, workspace)
        case ending if ending in ENDINGS or ending == ".scxml":
            workspace.check(path)
        case _:  # another format: some editors send every file of a folder
            if path.name.lower().startswith("config"):
                _check_configuration(path, workspace)
    return workspace.report


def _encoding(buffer: Buffer) -> str:
    """In which a text is read again: XML may declare another one than UTF-8."""
    return declared_encoding(buffer.text) if buffer.path.suffix.lower() == ENDING else "utf-8"


def _check_network(path: Path, workspace: Workspace) -> Report:
    from ..deploy.hosts.addresses import is_own
    from ..deploy.planner import make_plan  # imported late: slow, and only needed for DDSL

    make_plan(path, workspace, is_here=is_own)
    check_network(path, workspace)
    return Report([each for each in workspace.report.diagnostics if each.code != "not-generated"])


def _check_configuration(path: Path, workspace: Workspace) -> None:
    """Check a configuration. A file without a component beside it, such as `pyproject.toml`, is not checked."""
    from ..deploy.configuration import check_configuration, is_configuration, model_beside

    if is_configuration(path) and model_beside(path):
        check_configuration(path, workspace)


def _scan(folders: Iterable[Path], *, deep: bool) -> Iterator[Path]:
    visited = 0
    for folder in folders:
        for where, below, files in os.walk(folder):
            below[:] = sorted(each for each in below if deep and not _is_passed_over(where, each))
            for name in sorted(files):
                if name.lower().endswith(ENDINGS):
                    yield Path(where, name)
            visited += 1
            if visited >= MAX_FOLDERS:
                return


def _is_passed_over(where: str, name: str) -> bool:
    return name.startswith(".") or name in _PASSED_OVER or os.path.exists(os.path.join(where, name, "pyvenv.cfg"))
