"""What killed components left in the run-time folder is removed, and nothing of those who live."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.deploy.launcher.clearing import clear_up
from robocomp_py.transports.directory import Directory
from robocomp_py.transports.exclusive import claim
from robocomp_py.transports.members import Entry
from robocomp_py.transports.runtime_folder import runtime_dir

ENTRY = Entry("serves", "world/Laser/getLaserData", 1, "")

KILLED = """
import os, signal
from robocomp_py.transports.directory import Directory
from robocomp_py.transports.members import Entry
from robocomp_py.transports.runtime_folder import runtime_dir
from robocomp_py.transports.exclusive import claim
folder = runtime_dir() / "zeromq"
member = Directory(folder).join("world")
member.add(Entry("serves", "world/Laser/getLaserData", 1, ""))
member.address("router").touch()
claim(folder / "served", "world/Laser/getLaserData", "world")
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def run_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path / "run"))
    return runtime_dir()


def files(folder: Path) -> list[str]:
    return sorted(str(each.relative_to(folder)) for each in folder.rglob("*") if not each.is_dir())


def test_files_of_a_killed_component_are_removed_even_after_a_recent_look(run_time: Path) -> None:
    subprocess.run([sys.executable, "-c", KILLED], check=False)
    assert len(files(run_time)) == 6
    for folder in ("zeromq", "zeromq/served"):
        (run_time / folder / "swept").touch()  # as if there were hundreds
    clear_up()
    assert files(run_time) == []


def test_files_of_live_components_and_of_other_programs_are_kept(run_time: Path) -> None:
    member = Directory(run_time / "zeromq").join("world")
    member.add(ENTRY)
    served = claim(run_time / "zeromq" / "served", ENTRY.channel, "world")
    (run_time / "deploy").mkdir()
    (run_time / "deploy" / "999999999-1.lock").touch()
    before = files(run_time)
    clear_up()
    assert files(run_time) == before
    served.close()
    member.close()
