"""A program that forgets to close a transport ends all the same."""

from __future__ import annotations

import subprocess
import sys

import pytest

from robocomp_py.testing.patience import SOON

PROGRAM = """
import sys
from robocomp_py.transports.base import TransportConfig, find_transport
transport = find_transport(sys.argv[1])(TransportConfig(owner="forgotten"))
"""


@pytest.mark.parametrize(
    "middleware", ["inproc", "shm", "zeromq", "zenoh", "dds", pytest.param("ice", marks=pytest.mark.tool)]
)
def test_a_program_that_forgets_to_close_its_transport_ends(middleware: str) -> None:
    command = [sys.executable, "-c", PROGRAM, middleware]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6)
    assert done.returncode == 0
    assert "forgotten: not closed at the end of the program" in done.stderr
