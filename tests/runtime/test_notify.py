"""The messages of a process to its launcher."""

from __future__ import annotations

import contextlib
import secrets
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.runtime import notify as notify_module
from robocomp_py.runtime.notify import READY_FILE, notify
from robocomp_py.testing.patience import SOON


@pytest.fixture(params=["a file", "an abstract name"])
def launcher(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[socket.socket]:
    name = f"@rc-{secrets.token_hex(8)}" if request.param == "an abstract name" else str(tmp_path / "notify")
    monkeypatch.setenv("NOTIFY_SOCKET", name)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.settimeout(SOON)
        listening.bind(name.replace("@", "\0", 1))
        yield listening


def _fill(launcher: socket.socket) -> None:
    """Until it takes no more."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other, contextlib.suppress(BlockingIOError):
        other.connect(launcher.getsockname())
        other.setblocking(False)
        while True:
            other.send(b"more")


def test_a_notification_is_one_datagram(launcher: socket.socket) -> None:
    notify("READY=1", "STATUS=calm")
    assert launcher.recv(1000) == b"READY=1\nSTATUS=calm"


def test_a_launcher_that_is_busy_is_waited_for(launcher: socket.socket) -> None:
    _fill(launcher)
    telling = threading.Thread(target=notify, args=("READY=1",))
    telling.start()
    telling.join(0.01)  # most likely, it waits by now
    told = b""
    while told != b"READY=1":
        told = launcher.recv(1000)
    telling.join()


def test_readiness_reaches_a_launcher_that_was_stopped_meanwhile(
    launcher: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(notify_module, "_SEND_TIMEOUT", 0.05)
    _fill(launcher)
    notify("STATUS=missed")
    notify("READY=1")
    told = []
    while not told or told[-1] != b"READY=1":
        told.append(launcher.recv(1000))
    assert b"STATUS=missed" not in told


def test_notifying_a_launcher_that_is_gone_does_not_fail(launcher: socket.socket) -> None:
    launcher.close()
    notify("READY=1")


def test_a_file_is_there_while_a_process_is_ready(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = tmp_path / "ready"
    monkeypatch.setenv(READY_FILE, str(shown))
    notify("STATUS=waiting for laser")
    assert not shown.exists()
    notify("READY=1\nSTATUS=")
    assert shown.exists()
    notify("WATCHDOG=1")
    assert shown.exists()
    notify("STOPPING=1")
    assert not shown.exists()


def test_a_ready_file_that_cannot_be_made_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(READY_FILE, str(tmp_path / "nowhere" / "ready"))
    notify("READY=1")
    notify("STOPPING=1")
    assert not (tmp_path / "nowhere").exists()
