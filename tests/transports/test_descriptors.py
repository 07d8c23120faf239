"""A process that has few file descriptors left: transports open or say what is missing, and leave nothing behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.testing.patience import SOON

# Without DDS and Zenoh: Cyclone DDS crashes where it can open no socket, and Zenoh ends threads of its own.
TRANSPORTS = pytest.param("ice", marks=pytest.mark.tool), "shm", "zeromq"

MOST = 24
"""Descriptors with which every transport opens."""

OPENING = """
import os, resource, sys
from robocomp_py.errors import ConfigurationError, TransportError
from robocomp_py.transports.base import TransportConfig, find_transport
from robocomp_py.transports.runtime_folder import runtime_dir

def of_members():
    return {path for path in runtime_dir().rglob("*") if path.name.partition("-")[0] == str(os.getpid())}

open_transport, most = find_transport(sys.argv[1]), int(sys.argv[2])
open_transport(TransportConfig()).close()  # libraries keep some descriptors from then on
soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
for left in range(most + 1):
    begin = max(map(int, os.listdir("/proc/self/fd")))  # without gaps below, in which more could be opened
    filled = [os.dup(0) for _ in range(begin - len(os.listdir("/proc/self/fd")) + 2)]
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(begin, *filled) + 1 + left, hard))
    try:
        open_transport(TransportConfig()).close()
        outcome = "opened"
    except (ConfigurationError, TransportError) as exc:
        outcome = str(exc)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    for each in filled:
        os.close(each)
    assert not of_members(), (left, outcome, of_members())
    print(outcome)
"""


@pytest.mark.parametrize("middleware", TRANSPORTS)
def test_a_transport_opens_or_says_that_files_are_missing_and_leaves_none(
    middleware: str, own_runtime_folder: Path
) -> None:
    program = [sys.executable, "-c", OPENING, middleware, str(MOST)]
    done = subprocess.run(program, capture_output=True, text=True, timeout=SOON * 6)
    assert done.returncode == 0, done.stderr
    outcomes = done.stdout.splitlines()
    assert len(outcomes) == MOST + 1
    assert "Too many open files" in outcomes[0]
    assert outcomes[-1] == "opened"
    for each in outcomes:
        assert each == "opened" or "Too many open files" in each or "let it have more (ulimit -n" in each
