"""Files to disk: all of a component or nothing, and never over anybody's own."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import RobocompError
from .generate import Artifact, Owner

_MARK = "# Generated from "


class GenerationError(RobocompError):
    """Nothing was written; the message says why."""


@dataclass
class Changes:
    """What a run did, as paths below the component's folder."""

    written: list[str] = field(default_factory=list)
    removed: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    """Files of the user that were left alone."""


def write(artifacts: Sequence[Artifact], root: Path) -> Changes:
    """Bring a component's folder up to date. Raises GenerationError, and leaves everything as it was."""
    changes = _changes(artifacts, root)
    if not changes.written and not changes.removed:
        return changes
    try:
        root.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=".rcgen-", dir=root))
    except OSError as exc:
        raise GenerationError(f"{root}: {exc.strerror}; nothing was written") from exc
    try:
        _stage(artifacts, root, staging)
        _commit(artifacts, root, staging)
    except OSError as exc:
        raise GenerationError(f"{exc.filename or root}: {exc.strerror}; nothing was changed") from exc
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return changes


def outdated(artifacts: Sequence[Artifact], root: Path) -> list[str]:
    """What `write` would do, a line each; empty if all is up to date."""
    changes = _changes(artifacts, root)
    return [*(f"out of date: {root / name}" for name in changes.written)] + [
        f"no longer generated: {root / name}" for name in changes.removed
    ]


def is_generated(path: Path) -> bool:
    """Whether rcgen wrote a file, and may do so again."""
    with path.open(encoding="utf-8", errors="replace") as file:
        return file.readline().startswith(_MARK)


def _changes(artifacts: Sequence[Artifact], root: Path) -> Changes:
    changes = Changes()
    for artifact in artifacts:
        path = root / artifact.path
        if artifact.owner is Owner.USER:
            (changes.kept if path.exists() else changes.written).append(str(artifact.path))
        elif not path.exists() or path.read_text(encoding="utf-8") != artifact.text:
            if path.exists() and not is_generated(path):
                raise GenerationError(f"{path} was not written by rcgen; move it away, its name is needed")
            changes.written.append(str(artifact.path))
    wanted = {root / artifact.path for artifact in artifacts}
    changes.removed += [str(p.relative_to(root)) for p in _generated(root) if p not in wanted]
    return changes


def _generated(root: Path) -> Iterable[Path]:
    """The files in the generic part that rcgen wrote, once or now."""
    return sorted(path for path in (root / "generic").glob("*.py") if is_generated(path))


def _stage(artifacts: Sequence[Artifact], root: Path, staging: Path) -> None:
    """The new generic part, with what else is in the old one, and the user's files that do not exist yet."""
    generic = root / "generic"
    if generic.is_dir():
        shutil.copytree(generic, staging / "generic", ignore=lambda *_: ["__pycache__"])
        for old in _generated(staging):
            old.unlink()
    for artifact in artifacts:
        if artifact.owner is Owner.GENERATOR or not (root / artifact.path).exists():
            path = staging / artifact.path
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(artifact.text, encoding="utf-8")


def _commit(artifacts: Sequence[Artifact], root: Path, staging: Path) -> None:
    made: list[Path] = []
    generic, old = root / "generic", staging / "replaced"
    try:
        for artifact in artifacts:
            path = root / artifact.path
            if artifact.owner is Owner.USER and not path.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
                (staging / artifact.path).rename(path)
                made.append(path)
        if generic.exists():
            generic.rename(old)
        (staging / "generic").rename(generic)
    except OSError:
        for path in made:
            path.unlink()
        if old.exists():
            old.rename(generic)
        raise
