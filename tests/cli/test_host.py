"""`rc host`: what components share, without a deployer."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.cli import rc
from robocomp_py.testing.patience import SOON

from .losing import run_losing


def test_it_says_when_it_is_ready_and_ends_by_a_signal(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as told:
        told.bind(str(tmp_path / "told"))
        told.settimeout(SOON * 3)  # a process has to start first
        environment = os.environ | {
            "NOTIFY_SOCKET": str(tmp_path / "told"),
            "ROBOCOMP_RUNTIME_DIR": str(tmp_path / "r"),
        }
        command = [sys.executable, "-m", "robocomp_py.cli.rc", "host", "zenoh"]
        with subprocess.Popen(command, env=environment) as router:
            try:
                assert "READY=1" in told.recv(4096).decode()
                assert list((tmp_path / "r" / "zenoh").iterdir())
            finally:
                router.send_signal(signal.SIGTERM)
            assert router.wait(SOON) == 128 + signal.SIGTERM


def test_a_signal_that_came_before_it_listens_to_any_ends_it_even_if_its_exception_got_lost(tmp_path: Path) -> None:
    environment = os.environ | {"ROBOCOMP_RUNTIME_DIR": str(tmp_path / "r")}
    done = run_losing("SIGTERM", "rc", "host", "host", "zenoh", env=environment)
    assert (done.returncode, done.stdout) == (128 + signal.SIGTERM, "")


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["zeromq"], 0, "zeromq needs no shared process"),
        (["zenho"], 2, "unknown middleware `zenho`"),
        (["zenoh", "--set", "oops"], 2, "not key=value"),
        (["zenoh", "--set", "transports.zenoh.conect=1"], 1, "unknown transport option 'conect'"),
    ],
)
def test_it_says_what_it_cannot_do(
    arguments: list[str], code: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rc.main(["host", *arguments]) == code
    assert told in capsys.readouterr().err
