"""The project that is generated for one middleware after the other: its files, and how it runs."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Mapping
from pathlib import Path

from .. import process

START = Path(__file__).parent / "start"
INTERFACES = Path(__file__).parent / "interfaces"
COMPONENTS = "speaker", "listener"
PATIENCE = 120.0
"""Seconds in which a run has ended."""

Files = Mapping[str, bytes]


def copy(root: Path) -> None:
    """A project as it is before anything is generated."""
    shutil.copytree(START, root, ignore=shutil.ignore_patterns("__pycache__"))


def generate(root: Path, middleware: str) -> Files:
    """`rcgen` for both components; the files that there are then."""
    for name in COMPONENTS:
        command = _command("rcgen", f"{name}/{name}.cdsl", "--middleware", middleware, "-I", str(INTERFACES))
        done = subprocess.run(command, cwd=root, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"rcgen {name} --middleware {middleware}:\n{done.stdout}{done.stderr}")
    return {
        str(file.relative_to(root)): file.read_bytes()
        for file in sorted(root.rglob("*"))
        if file.is_file() and "__pycache__" not in file.parts
    }


def differing(one: Files, other: Files) -> set[str]:
    """Files that one has and the other has not, or has with other bytes."""
    return {path for path in one.keys() | other.keys() if one.get(path) != other.get(path)}


def specific(files: Files) -> Files:
    """What `rcgen` wrote once, or never: all but the generic parts."""
    return {path: text for path, text in files.items() if "generic" not in Path(path).parts}


def sha256(files: Files) -> str:
    """Of the names and the bytes of all of them."""
    digest = hashlib.sha256()
    for path, text in sorted(files.items()):
        digest.update(f"{path} {len(text)} ".encode() + text)
    return digest.hexdigest()


def run(root: Path, middleware: str) -> float:
    """Let one ask the other; the median of its round trips, in µs, as its own log tells it."""
    together = middleware == "inproc"  # which is within one process
    commands = [["speaker", "+", "listener"]] if together else [["speaker"], ["listener"]]
    with process.folder() as runtime, contextlib.ExitStack() as stack:
        for command in commands:
            options = {"cwd": root, "env": os.environ | {"NO_COLOR": "1", "ROBOCOMP_RUNTIME_DIR": runtime}}
            output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
            running = stack.enter_context(process.running(_command("rc", "run", *command), **options, **output))
            assert running.stdout is not None
            lines = stack.enter_context(running.stdout)
        impatience = threading.Timer(PATIENCE, running.kill)
        impatience.start()
        stack.callback(impatience.cancel)
        told = []
        for line in lines:
            told.append(line.decode())
            found = re.search(r"a median of ([0-9.]+) µs", told[-1])
            if found:
                return float(found[1])
    raise RuntimeError(f"{middleware}: nothing was measured:\n{''.join(told)}")


def _command(program: str, *arguments: str) -> list[str]:
    return [sys.executable, "-m", f"robocomp_py.cli.{program}", *arguments]
