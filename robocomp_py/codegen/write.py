"""Files to disk: all of some components or nothing, and never over anybody's own."""

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
"""How our files begin: Python, OMG IDL, XML, JSON."""


@dataclass
class Changes:
    """What a run does, as paths below the component's folder."""

    missing: list[str] = field(default_factory=list)
    outdated: list[str] = field(default_factory=list)
    removed: list[str] = field(default_factory=list)
    """What was generated once, and is not any more."""
    kept: list[str] = field(default_factory=list)
    """Files of the user that are left alone."""

    @property
    def written(self) -> list[str]:
        return self.missing + self.outdated

    def lines(self, root: Path) -> list[str]:
        """What is out of date, a line each."""
        kinds = (("missing", self.missing), ("out of date", self.outdated), ("no longer generated", self.removed))
        return [f"{kind}: {root / name}" for kind, names in kinds for name in names]


def write(*components: tuple[Path, Sequence[Artifact]]) -> list[Changes]:
    """Bring components' folders up to date. Raises GenerationError, and leaves all of them as they were.

    Signals that come meanwhile have their effect when all is done: it takes some milliseconds only.
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
    """What `write` would do. Raises GenerationError for what it would refuse."""
    changes = Changes()
    with _refusing(root):
        for artifact in artifacts:
            _add(changes, artifact, root)
        wanted = {str(artifact.path) for artifact in artifacts}
        whole = any(name.startswith("generic/") for name in wanted)  # else it is nothing of a component
        for path in _generated(root / "generic") if whole else ():
            name = str(path.relative_to(root))
            if name not in wanted:
                changes.removed.append(name)
        _check_owner(artifacts, root)
    return changes


def origin(path: Path) -> str:
    """The model a file was generated from, by rcgen; "" for a file that it did not write."""
    with path.open("rb") as file:
        found = _MARK.match(file.read(1000))
    return found[1].decode(errors="replace") if found else ""


def _generated(generic: Path) -> list[Path]:
    """The files that a generic part holds and rcgen wrote. Folders that are links are somebody else's."""
    folders = [generic, *(path for path in generic.glob("*") if path.is_dir() and not path.is_symlink())]
    files = sorted(path for folder in folders for path in folder.glob("*") if path.suffix in _SUFFIXES)
    return [path for path in files if _is_file(path) and origin(path)]


_SUFFIXES = {".py", ".idl", ".ice", ".json"}


def _add(changes: Changes, artifact: Artifact, root: Path) -> None:
    """Compare one file."""
    path, name = root / artifact.path, str(artifact.path)
    for folder in (root, *reversed([root / parent for parent in artifact.path.parents][:-1])):
        if os.path.lexists(folder) and not folder.is_dir():
            raise GenerationError(f"{folder} is no folder, but one of that name is needed; nothing was written")
        if folder != root and folder.is_symlink():
            raise GenerationError(
                f"{folder} is a link; rcgen writes into folders of its own only, so nothing was written"
            )
    if not os.path.lexists(path):
        changes.missing.append(name)
    elif not path.is_file():
        raise GenerationError(f"{path} is no file, but one of that name is needed; nothing was written")
    elif artifact.owner is Owner.USER:
        changes.kept.append(name)
    elif not _is_file(path) or not origin(path):
        raise GenerationError(f"{path} was not written by rcgen; move it away, its name is needed; nothing was written")
    elif path.read_bytes() != artifact.text.encode():
        changes.outdated.append(name)


def _check_owner(artifacts: Sequence[Artifact], root: Path) -> None:
    """Refuse to put one component over another one in the same folder."""
    path = root / "generic" / "genericworker.py"
    new = next((artifact for artifact in artifacts if root / artifact.path == path), None)
    if new is None or not path.is_file():
        return
    found = _MARK.match(new.text.encode())
    before, now = origin(path), found[1].decode() if found else ""
    if before != now and not ((root / now).is_file() and not (root / before).is_file()):
        raise GenerationError(
            f"{root / 'generic'} was generated from {before}: give {now} a folder of its own (-o DIR), "
            "or remove that one; nothing was written"
        )


def _is_file(path: Path) -> bool:
    """Whether something is a file itself, and not only leads to one."""
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
            (self._staging / _LOCK).unlink(missing_ok=True)  # so that nobody takes it for stale
            where = ", ".join(f"{path} (what it held is in {aside})" for path, aside in lost)
            raise GenerationError(f"{exc}; and this could not be put back: {where}") from exc
        shutil.rmtree(self._staging, ignore_errors=True)
        if exc is not None:
            self._remove_made()
            return
        for folder in self._left:
            with contextlib.suppress(OSError):  # there is something left in it
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
        """Put back what was there; returns what cannot be, each with where it is now."""
        for path in self._made:
            if not path.is_dir():
                with contextlib.suppress(OSError):  # then nothing can be put back there, which is said below
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
                with contextlib.suppress(OSError):  # somebody else put something into it
                    path.rmdir()


# Staging folders. Whoever made one holds a lock in it as long as he lives, however he ends; one whose lock is free
# was left behind. What it holds is the generator's own, half written or replaced: nothing that a user wrote.


def _locked(staging: Path) -> int:
    """Put a lock into a folder; its descriptor. There is no moment at which others could take it."""
    lock = os.open(staging / f"{_LOCK}-new", os.O_CREAT | os.O_RDWR, 0o600)
    with contextlib.suppress(OSError):  # a disk without locks: then nobody can tell that it is stale
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
    """Keep signals waiting that would end us. By handlers: a mask would hold for this thread, and not for those that
    libraries have started.
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
