"""What a process tells whoever launched it."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.runtime.notify import READY_FILE, notify


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


def test_a_file_that_cannot_be_made_stops_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(READY_FILE, str(tmp_path / "nowhere" / "ready"))
    notify("READY=1")
    notify("STOPPING=1")
    assert not (tmp_path / "nowhere").exists()
