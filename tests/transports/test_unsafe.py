"""What transports take from Linux and CPython is there; without it, they do as their table says."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.testing.patience import SOON
from robocomp_py.transports import unsafe
from robocomp_py.transports.inotify import Watch

from ..leftovers import killed_on_failure

PRIVATE = ("_inotify_init1", "_inotify_add_watch", "_prctl", "_ensure", "_release", "_inc_ref")
MISSING: Any = None


def test_all_private_names_exist_in_this_python() -> None:
    assert [name for name in PRIVATE if getattr(unsafe, name) is None] == []


def test_a_change_of_a_watched_folder_is_input(tmp_path: Path) -> None:
    descriptor = unsafe.watch()
    try:
        unsafe.add_watch(descriptor, str(tmp_path), 0x100)
        (tmp_path / "file").touch()
        assert select.select([descriptor], [], [], SOON)[0] == [descriptor]
        with pytest.raises(FileNotFoundError):
            unsafe.add_watch(descriptor, str(tmp_path / "missing"), 0x100)
    finally:
        os.close(descriptor)


@pytest.mark.parametrize("missing", ["_inotify_init1", "_inotify_add_watch"])
def test_where_folders_cannot_be_watched_nothing_is(
    missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(unsafe, missing, MISSING)
    watch = Watch(tmp_path)
    watch.add(str(tmp_path))
    assert not watch.able
    assert not watch.watches(str(tmp_path))
    assert not watch.read()
    assert caplog.text == ""


PARENT = """\
import os, subprocess, sys
from robocomp_py.transports.unsafe import end_with_parent
child = subprocess.Popen([sys.executable, "-c", "input()"], preexec_fn=end_with_parent, stdin=subprocess.PIPE)
print(child.pid, flush=True)
input()
"""


def test_a_child_ends_with_its_parent() -> None:
    with killed_on_failure([sys.executable, "-c", PARENT], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as parent:
        assert parent.stdout
        child = os.pidfd_open(int(parent.stdout.readline()))
        try:
            parent.send_signal(signal.SIGKILL)
            assert select.select([child], [], [], SOON)[0] == [child]
        finally:
            os.close(child)


def test_a_thread_keeps_its_state_and_works_on() -> None:
    done: list[int] = []

    def run() -> None:
        unsafe.keep_thread_state()
        done.append(1)
        unsafe.release_thread_state()

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(SOON)
    assert done == [1]


@pytest.mark.parametrize("missing", ["_ensure", "_release"])
def test_a_state_is_kept_only_if_it_can_be_released(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    called: list[str] = []
    for name in ("_ensure", "_release"):
        monkeypatch.setattr(unsafe, name, MISSING if name == missing else called.append)
    unsafe.keep_thread_state()
    unsafe.release_thread_state()
    assert called == []


def test_a_kept_object_is_not_finalized(monkeypatch: pytest.MonkeyPatch) -> None:
    class Kept:
        def __del__(self) -> None:
            finalized.append(self)

    finalized: list[object] = []
    unsafe.keep(Kept())
    assert finalized == []
    monkeypatch.setattr(unsafe, "_inc_ref", MISSING)
    unsafe.keep(Kept())
    assert len(finalized) == 1


def test_without_prctl_nothing_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unsafe, "_prctl", MISSING)
    unsafe.end_with_parent()
