"""Finds the first commit of Git with which a component does something else than its diary says."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from ...errors import ConfigurationError, RobocompError

Differs = Callable[[Path], str]
"""Takes the folder of a component, and returns its first difference from the diary, or ""."""

_DEADLINE = 60.0
"""Seconds for one command of Git."""


class Found(NamedTuple):
    commit: str
    subject: str
    difference: str
    tried: int
    """Commits that were run again."""


def first_that_differs(folder: Path, good: str, bad: str, differs: Differs) -> Found:
    """The first commit after `good`, up to `bad`, that differs.

    Raises ConfigurationError if there are no such commits, or if `good` differs or `bad` does not.
    """
    root = Path(_git(folder, "rev-parse", "--show-toplevel"))
    inside = folder.resolve().relative_to(root.resolve())
    first = _commit(folder, good)
    commits = _git(folder, "rev-list", "--reverse", "--first-parent", f"{first}..{_commit(folder, bad)}").split()
    if not commits:
        raise ConfigurationError(f"there is no commit in {good}..{bad}")
    tried: dict[str, str] = {}

    def is_bad(commit: str) -> bool:
        with _checked_out(root, inside, folder, commit) as there:
            tried[commit] = differs(there)
        return bool(tried[commit])

    if is_bad(first):
        raise ConfigurationError(f"{good} differs from the diary already; give a commit that does not")
    if not is_bad(commits[-1]):
        raise ConfigurationError(f"{bad} does not differ from the diary")
    low, high = 0, len(commits) - 1  # the first that differs is between them
    while low < high:
        middle = (low + high) // 2
        if is_bad(commits[middle]):
            high = middle
        else:
            low = middle + 1
    found = commits[low]
    return Found(found, _git(folder, "log", "-1", "--format=%s", found), tried[found], len(tried))


def _commit(folder: Path, name: str) -> str:
    try:
        return _git(folder, "rev-parse", "--verify", "--quiet", "--end-of-options", f"{name}^{{commit}}")
    except RobocompError as exc:
        raise ConfigurationError(f"`{name}` is no commit here") from exc


@contextlib.contextmanager
def _checked_out(root: Path, inside: Path, folder: Path, commit: str) -> Iterator[Path]:
    """The component as it was in a commit. Generated code that Git does not keep is that of today."""
    with tempfile.TemporaryDirectory(prefix="rerun-") as place:
        tree = Path(place) / "tree"
        _git(root, "worktree", "add", "--detach", "--quiet", str(tree), commit)
        try:
            there = tree / inside
            if not there.is_dir():
                raise ConfigurationError(f"commit {commit[:12]} has no folder {inside}")
            if not (there / "generic").exists():
                shutil.copytree(folder / "generic", there / "generic")
            yield there
        finally:
            _git(root, "worktree", "remove", "--force", str(tree))


def _git(folder: Path, *words: str) -> str:
    try:
        done = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True, timeout=_DEADLINE)
    except FileNotFoundError as exc:
        raise ConfigurationError("--bisect needs git, which is not installed") from exc
    except subprocess.TimeoutExpired as exc:
        raise RobocompError(f"git {words[0]} takes longer than {_DEADLINE:g} s") from exc
    if done.returncode:
        raise RobocompError(f"git {words[0]}: {done.stderr.strip() or f'exit status {done.returncode}'}")
    return done.stdout.strip()
