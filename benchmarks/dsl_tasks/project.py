"""A project that is worked on: what is written by hand is counted, and the generator is timed."""

from __future__ import annotations

import difflib
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

START = Path(__file__).parent / "start"
COMPONENTS = "talker", "greeter"


class Project:
    """A copy of the start in a folder of its own."""

    def __init__(self, root: Path, start: Path) -> None:
        self.root = root
        self.command: tuple[str, ...] | None = None
        """What starts the network, if a task has made something that does."""
        self.seconds = 0.0
        """What the generator took, where a task needed it."""
        self._before: dict[str, str] = {}
        shutil.copytree(start, root)

    def write(self, path: str, text: str) -> None:
        """A new file."""
        if (self.root / path).exists():
            raise ValueError(f"{path} exists already")
        self._put(path, "", text)

    def replace(self, path: str, old: str, new: str) -> None:
        """A change of a file, at the one place that reads `old`."""
        text = (self.root / path).read_text()
        if text.count(old) != 1:
            raise ValueError(f"{path} has {text.count(old)} places that read {old!r}")
        self._put(path, text, text.replace(old, new))

    def generate(self, *names: str) -> None:
        """`rcgen` for these components."""
        begun = time.perf_counter()
        for name in names:
            rcgen(self.root, name)
        self.seconds += time.perf_counter() - begun

    @property
    def touched(self) -> tuple[str, ...]:
        """The files that were written in."""
        return tuple(self._before)

    @property
    def lines(self) -> int:
        """How many lines were written, or changed; blank ones are free."""
        return sum(_written(before, (self.root / path).read_text()) for path, before in self._before.items())

    def _put(self, path: str, before: str, text: str) -> None:
        self._before.setdefault(path, before)
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)


def prepare(folder: Path) -> Path:
    """The start, with the generic part of its components."""
    shutil.copytree(START, folder, ignore=shutil.ignore_patterns("__pycache__"))
    for name in COMPONENTS:
        rcgen(folder, name)
    return folder


def rcgen(root: Path, name: str) -> None:
    """Generate a component. Raises RuntimeError if that fails."""
    command = [sys.executable, "-m", "robocomp_py.cli.rcgen", f"{name}/{name}.cdsl"]
    done = subprocess.run(command, cwd=root, env=os.environ | {"NO_COLOR": "1"}, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"rcgen {name}:\n{done.stdout}{done.stderr}")


def message(worker: type[Any], name: str) -> Any:
    """A class that a component's specific part imports."""
    return getattr(sys.modules[worker.__module__], name)


def _written(before: str, after: str) -> int:
    old, new = before.splitlines(), after.splitlines()
    changes = difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes()
    return sum(1 for tag, _, _, begin, end in changes if tag != "equal" for line in new[begin:end] if line.strip())
