"""What the example network tells when it is run to its end."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

EVENTS = (
    "exploring",
    "battery low",
    "at the charging station",
    "battery charged",
    "found a victim",
    "help was called",
)


def check(output: str) -> None:
    """Whether all of the story is there, in order."""
    places = [output.find(event) for event in EVENTS]
    assert -1 not in places, output
    assert places == sorted(places), output


def run(*command: object, cwd: Path, environment: Mapping[str, str] | None = None) -> str:
    """What a command of Python's printed; it has to succeed."""
    done = subprocess.run(
        [sys.executable, *map(str, command)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, **(environment or {})},
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr
