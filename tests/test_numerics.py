"""Commands that look at what runs load numpy without threads for linear algebra."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

THREADS = "OPENBLAS_NUM_THREADS"

PROGRAM = f"""
import os
from robocomp_py.numerics import one_thread
with one_thread():
    import numpy
    seen = os.environ.get({THREADS!r})
print(len(os.listdir("/proc/self/task")), seen, os.environ.get({THREADS!r}))
"""


def loaded(**environment: str) -> str:
    """The number of threads after numpy was imported; the variable meanwhile, and afterwards."""
    without = {name: value for name, value in os.environ.items() if name != THREADS}
    command = [sys.executable, "-c", PROGRAM]
    return subprocess.run(command, env=without | environment, capture_output=True, text=True, check=True).stdout


def test_numpy_starts_no_threads() -> None:
    assert loaded() == "1 1 None\n"


def test_the_number_that_the_user_has_chosen_stays() -> None:
    *_, seen, after = loaded(**{THREADS: "2"}).split()
    assert (seen, after) == ("2", "2")


@pytest.mark.parametrize("command", ["list", "echo"])
def test_commands_that_look_load_numpy_so(command: str) -> None:
    program = f"""
import os, sys
from robocomp_py.cli import rc
rc.module({command!r}).run = lambda options: print(os.environ[{THREADS!r}]) or 0
sys.argv[1:] = [{command!r}, *["LaserPub"] * ({command!r} == "echo")]
rc.main()
print({THREADS!r} in os.environ)
"""
    without = {name: value for name, value in os.environ.items() if name != THREADS}
    command_line = [sys.executable, "-c", program]
    done = subprocess.run(command_line, env=without, capture_output=True, text=True, check=True)
    assert done.stdout == "1\nFalse\n"
