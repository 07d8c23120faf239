"""What launching takes from the C library and CPython is there; without it, the same is seen from outside."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.deploy.launcher import unsafe
from robocomp_py.testing.patience import SOON

PRIVATE = ("_prctl", "_fork", "_exit", "_wait_for_threads", "_run_exit_functions")

ENDING = """\
import atexit, sys, threading, time
from robocomp_py.deploy.launcher import unsafe
for name in sys.argv[2:]:
    setattr(unsafe, name, None)
atexit.register(print, "registered", flush=True)
asked = threading.Event()
threading.Thread(target=lambda: (asked.wait(10), print("waited for", flush=True))).start()
left_open = open(sys.argv[1], "w")
left_open.write("written out")
asked.set()
unsafe.end(3, frozenset(sys.modules))
"""


def test_all_private_names_exist_in_this_python() -> None:
    assert [name for name in PRIVATE if getattr(unsafe, name) is None] == []


@pytest.mark.parametrize("missing", [(), ("_wait_for_threads",), ("_run_exit_functions",), ("_exit",)])
def test_a_process_ends_as_python_ends(missing: tuple[str, ...], tmp_path: Path) -> None:
    file = tmp_path / "left open"
    command = [sys.executable, "-c", ENDING, str(file), *missing]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6)
    assert (ended.returncode, ended.stdout.splitlines(), ended.stderr) == (3, ["waited for", "registered"], "")
    assert file.read_text() == "written out"


@pytest.mark.parametrize("missing", [(), ("_fork",)])
def test_a_fork_is_a_process_of_its_own(missing: tuple[str, ...]) -> None:
    code = """\
import os, sys
from robocomp_py.deploy.launcher import unsafe
for name in sys.argv[1:]:
    setattr(unsafe, name, None)
child = unsafe.fork()
if not child:
    os._exit(5)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    done = subprocess.run([sys.executable, "-c", code, *missing], capture_output=True, text=True, timeout=SOON * 6)
    assert (done.returncode, done.stdout, done.stderr) == (0, "5\n", "")


def test_without_prctl_nothing_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unsafe, "_prctl", None)
    unsafe.show_command(["rc"], "name", 0, 0)
    assert Path(f"/proc/{os.getpid()}/comm").read_text().strip() != "name"


def test_a_command_line_without_room_is_left_alone() -> None:
    assert unsafe.room_of_command(1 << 20) == (0, 0)
