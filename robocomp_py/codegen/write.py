"""Writes generated files: all files of some components or none, and never over files that rcgen did not write."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
import signal
import stat
import tempfile
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from .generate import Artifact, GenerationError, Owner

_MARK = re.compile(rb'(?:# |// |<!-- |\{\n  "about": ")Generated from (.+) by rcgen ')
"""Matches the first line of generated files: Python, OMG IDL, XML, JSON."""


@dataclass
class Changes:
    """The changes of a run, as paths below the component's folder."""

    missing: list[str] = field(default_factory=list)
    outdated: list[str] = field(default_factory=list)
    removed: list[str] = field(default_factory=list)
    """Files that are no longer generated."""
    kept: list[str] = field(default_factory=list)
    """Files of the user, which stay unchanged."""

    @property
    def written(self) -> list[str]:
        return self.missing + self.outdated

    def lines(self, root: Path) -> list[str]:
        """One line for each file that is out of date."""
        kinds = (("missing", self.missing), ("out of date", self.outdated), ("no longer generated", self.removed))
        return [f"{kind}: {root / name}" for kind, names in kinds for name in names]


def write(*components: tuple[Path, Sequence[Artifact]]) -> list[Changes]:
    """Bring components' folders up to date. If it raises GenerationError, all folders are unchanged.

    Signals are handled afterwards, some milliseconds later.
    """
    planned = [(root, artifacts, compare(artifacts, root)) for root, artifacts in components]
    for root, _, _ in planned:
        remove_stale(root)
    with _undisturbed(), contextlib.ExitStack() as together:
        for root, artifacts, changes in planned:
            if changes.written or changes.removed:
                disk = together.enter_context(_Transaction(root))
                texts = {str(artifact.path): artifact.text for artifact in artifacts}
                for name in changes.written:
                    disk.replace(root / name, texts[name])
                for name in changes.removed:
                    disk.remove(root / name)
    return [changes for _, _, changes in planned]


def compare(artifacts: Sequence[Artifact], root: Path) -> Changes:
    """What `write` would do. Raises GenerationError if `write` would."""
    changes = Changes()
    with _refusing(root):
        for artifact in artifacts:
            _add(changes, artifact, root)
        wanted = {str(artifact.path) for artifact in artifacts}
        whole = any(name.startswith("generic/") for name in wanted)  # otherwise it is not a component
        for path in _generated(root / "generic") if whole else ():
            name = str(path.relative_to(root))
            if name not in wanted:
                changes.removed.append(name)
        _check_owner(artifacts, root)
    return changes


def origin(path: Path) -> str:
    """The model that rcgen generated a file from; "" for a file that rcgen did not write."""
    with path.open("rb") as file:
        found = _MARK.match(file.read(1000))
    return found[1].decode(errors="replace") if found else ""


def _generated(generic: Path) -> list[Path]:
    """The files of a generic part that rcgen wrote. Linked folders are skipped."""
    folders = [generic, *(path for path in generic.glob("*") if path.is_dir() and not path.is_symlink())]
    files = sorted(path for folder in folders for path in folder.glob("*") if path.suffix in _SUFFIXES)
    return [path for path in files if _is_file(path) and origin(path)]


_SUFFIXES = {".py", ".idl", ".ice", ".json"}


def _add(changes: Changes, artifact: Artifact, root: Path) -> None:
    """Compare one file."""
    path, name = root / artifact.path, str(artifact.path)
    for folder in (root, *reversed([root / parent for parent in artifact.path.parents][:-1])):
        if os.path.lexists(folder) and not folder.is_dir():
            raise GenerationError(f"{folder} is not a folder, but a folder of that name is needed; nothing was written")
        if folder != root and folder.is_symlink():
            raise GenerationError(
                f"{folder} is a link, and rcgen does not write into linked folders; nothing was written"
            )
    if not os.path.lexists(path):
        changes.missing.append(name)
    elif not path.is_file():
        raise GenerationError(f"{path} is not a file, but a file of that name is needed; nothing was written")
    elif artifact.owner is Owner.USER:
        changes.kept.append(name)
    elif not _is_file(path) or not origin(path):
        raise GenerationError(
            f"{path} was not written by rcgen; rename it, as rcgen needs the name; nothing was written"
        )
    elif path.read_bytes() != artifact.text.encode():
        changes.outdated.append(name)


def _check_owner(artifacts: Sequence[Artifact], root: Path) -> None:
    """Refuse to overwrite another component in the same folder."""
    path = root / "generic" / "genericworker.py"
    new = next((artifact for artifact in artifacts if root / artifact.path == path), None)
    if new is None or not path.is_file():
        return
    found = _MARK.match(new.text.encode())
    before, now = origin(path), found[1].decode() if found else ""
    if before != now and not ((root / now).is_file() and not (root / before).is_file()):
        raise GenerationError(
            f"{root / 'generic'} was generated from {before}: give {now} another folder (-o DIR), "
            "or remove the old one; nothing was written"
        )


def _is_file(path: Path) -> bool:
    """Whether a path is a regular file, not a link to one."""
    return stat.S_ISREG(path.lstat().st_mode)


class _Transaction:
    """Changes to a folder that are undone if not all of them succeed."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._made: list[Path] = []
        self._moved: list[tuple[Path, Path]] = []
        self._left: set[Path] = set()

    def __enter__(self) -> Self:
        try:
            with _refusing(self._root):
                self._make_folders(self._root)
                self._staging = Path(tempfile.mkdtemp(prefix=_STAGING, dir=self._root))
                self._made.append(self._staging)
                self._lock = _locked(self._staging)
        except BaseException:
            self._remove_made()
            raise
        return self

    def replace(self, path: Path, text: str) -> None:
        """Put a file with that text there."""
        with _refusing(path):
            new = self._staging / f"new-{len(self._moved)}-{len(self._made)}"
            new.write_text(text, encoding="utf-8", newline="\n")
            self._make_folders(path.parent)
            self._set_aside(path)
            new.rename(path)
            self._made.append(path)

    def remove(self, path: Path) -> None:
        """Remove a file, and its folder if that was the last one in it."""
        with _refusing(path):
            self._set_aside(path)
        self._left.add(path.parent)

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        lost = self._undo() if exc is not None else []
        os.close(self._lock)
        if lost:
            (self._staging / _LOCK).unlink(missing_ok=True)  # without a lock, `remove_stale` keeps it
            where = ", ".join(f"{path} (its old content is in {aside})" for path, aside in lost)
            raise GenerationError(f"{exc}; these files could not be restored: {where}") from exc
        shutil.rmtree(self._staging, ignore_errors=True)
        if exc is not None:
            self._remove_made()
            return
        for folder in self._left:
            with contextlib.suppress(OSError):  # it is not empty
                folder.rmdir()

    def _make_folders(self, folder: Path) -> None:
        missing = [each for each in (folder, *folder.parents) if not each.exists()]
        for each in reversed(missing):
            each.mkdir()
            self._made.append(each)

    def _set_aside(self, path: Path) -> None:
        if path.exists():
            aside = self._staging / f"old-{len(self._moved)}"
            path.rename(aside)
            self._moved.append((path, aside))

    def _undo(self) -> list[tuple[Path, Path]]:
        """Restore the old files. Returns those that could not be restored, each with its present place."""
        for path in self._made:
            if not path.is_dir():
                with contextlib.suppress(OSError):  # then the old file cannot be restored, which is reported below
                    path.unlink(missing_ok=True)
        lost = []
        for path, aside in reversed(self._moved):
            try:
                aside.rename(path)
            except OSError:
                lost.append((path, aside))
        return lost

    def _remove_made(self) -> None:
        for path in reversed(self._made):
            if path.is_dir():
                with contextlib.suppress(OSError):  # another process has put files into it
                    path.rmdir()


# Staging folders. A run holds a lock in its folder until its process ends, so a folder with a free lock is stale. It
# holds only files of the generator, new or replaced ones, never files of the user.


def _locked(staging: Path) -> int:
    """Create a lock in a folder, and return its descriptor. It is taken before it becomes visible by its name."""
    lock = os.open(staging / f"{_LOCK}-new", os.O_CREAT | os.O_RDWR, 0o600)
    with contextlib.suppress(OSError):  # a disk without locks: stale folders stay
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.rename(staging / f"{_LOCK}-new", staging / _LOCK)
    return lock


def remove_stale(root: Path) -> None:
    """Remove the staging folders of runs that were killed."""
    for staging in root.glob(f"{_STAGING}*"):
        with contextlib.suppress(OSError):
            lock = os.open(staging / _LOCK, os.O_RDWR | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(staging, ignore_errors=True)
            finally:
                os.close(lock)


_STAGING, _LOCK = ".rcgen-", "lock"


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Delay signals that would end the process. This uses handlers, because a signal mask would hold for this thread
    only, and not for threads that libraries have started.
    """
    waiting: list[int] = []
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(each) not in (signal.SIG_IGN, None):
                before[each] = signal.signal(each, lambda number, _: waiting.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in waiting:
            signal.raise_signal(number)


@contextlib.contextmanager
def _refusing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise GenerationError(f"{exc.filename2 or exc.filename or path}: {exc.strerror}; nothing was written") from exc
