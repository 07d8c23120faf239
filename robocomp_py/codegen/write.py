"""Files to disk: all of a component or nothing, and never over anybody's own."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from .generate import Artifact, GenerationError, Owner

_MARK = re.compile(rb"# Generated from (.+) by rcgen ")


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


def write(artifacts: Sequence[Artifact], root: Path) -> Changes:
    """Bring a component's folder up to date. Raises GenerationError, and leaves everything as it was."""
    changes = compare(artifacts, root)
    if changes.written or changes.removed:
        texts = {str(artifact.path): artifact.text for artifact in artifacts}
        with _Transaction(root) as disk:
            for name in changes.written:
                disk.replace(root / name, texts[name])
            for name in changes.removed:
                disk.remove(root / name)
    return changes


def compare(artifacts: Sequence[Artifact], root: Path) -> Changes:
    """What `write` would do. Raises GenerationError for what it would refuse."""
    changes = Changes()
    with _refusing(root):
        for artifact in artifacts:
            _add(changes, artifact, root)
        wanted = {str(artifact.path) for artifact in artifacts}
        for path in sorted((root / "generic").glob("*.py")):
            name = str(path.relative_to(root))
            if name not in wanted and _is_file(path) and origin(path):
                changes.removed.append(name)
        _check_owner(artifacts, root)
    return changes


def origin(path: Path) -> str:
    """The model a file was generated from, by rcgen; "" for a file that it did not write."""
    with path.open("rb") as file:
        found = _MARK.match(file.readline(1000))
    return found[1].decode(errors="replace") if found else ""


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

    def __enter__(self) -> Self:
        try:
            with _refusing(self._root):
                self._make_folders(self._root)
                self._staging = Path(tempfile.mkdtemp(prefix=".rcgen-", dir=self._root))
        except GenerationError:
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
        with _refusing(path):
            self._set_aside(path)

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        if exc is not None:
            self._undo()
        shutil.rmtree(self._staging, ignore_errors=True)
        if exc is not None:
            self._remove_made()

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

    def _undo(self) -> None:
        for path in self._made:
            if not path.is_dir():
                path.unlink(missing_ok=True)
        for path, aside in reversed(self._moved):
            aside.rename(path)

    def _remove_made(self) -> None:
        for path in reversed(self._made):
            if path.is_dir():
                with contextlib.suppress(OSError):  # somebody else put something into it
                    path.rmdir()


@contextlib.contextmanager
def _refusing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise GenerationError(f"{exc.filename2 or exc.filename or path}: {exc.strerror}; nothing was written") from exc
