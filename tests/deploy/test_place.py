"""A network runs once on a host, and who runs it can be asked for."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.deploy.place import AlreadyRuns, Place, Runner, file_name
from robocomp_py.errors import DeploymentError


def test_the_runner_of_a_network_is_known_until_it_ends(tmp_path: Path) -> None:
    mine, other = Place("Patrol", tmp_path), Place("Patrol", tmp_path)
    assert other.runner() is None
    mine.take("rcdeploy patrol.ddsl")
    runner = other.runner()
    assert runner
    assert (runner.pid, runner.command) == (os.getpid(), "rcdeploy patrol.ddsl")
    with pytest.raises(AlreadyRuns, match=rf"process {os.getpid()} \(rcdeploy patrol.ddsl\); to end it: rcdeploy down"):
        other.take()
    mine.release()
    mine.release()
    assert other.runner() is None
    other.take()
    other.release()


def test_two_networks_run_side_by_side(tmp_path: Path) -> None:
    patrol, rescue = Place("Patrol", tmp_path), Place("Rescue", tmp_path)
    patrol.take()
    rescue.take()
    rescue.release()
    assert patrol.runner()
    patrol.release()


def test_the_folder_is_the_users_alone_and_goes_with_what_is_of_no_use_any_more(tmp_path: Path) -> None:
    place = Place("Patrol", tmp_path)
    place.take()
    assert stat.S_IMODE(place.folder.stat().st_mode) == 0o700
    place.notify.mkdir()
    for file in (place.control, place.plan, place.leftovers, place.notify / "1"):
        file.touch()
    place.logs.mkdir()
    (place.logs / "laser.log").touch()
    place.release()
    assert [path.name for path in place.folder.rglob("*")] == ["logs", "laser.log"]


@pytest.fixture
def seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Runner | None]:
    """Who runs it, as far as others know, whenever something is removed."""
    found: list[Runner | None] = []
    remove = shutil.rmtree

    def removing(path: Path, ignore_errors: bool) -> None:
        found.append(Place("Patrol", tmp_path).runner())
        remove(path, ignore_errors)

    monkeypatch.setattr(shutil, "rmtree", removing)
    return found


def test_a_place_stays_taken_until_everything_is_removed(tmp_path: Path, seen: list[Runner | None]) -> None:
    place = Place("Patrol", tmp_path)
    place.take()
    place.release()
    assert [runner and runner.pid for runner in seen] == [os.getpid()]


class Fleeting(type(Path())):  # type: ignore[misc]  # the class of a path is that of the system
    """A folder that is removed when it is made for the first time, as by who releases it."""

    times = 0

    def mkdir(self, *arguments: Any, **options: Any) -> None:
        super().mkdir(*arguments, **options)
        Fleeting.times += 1
        if Fleeting.times == 1:
            self.rmdir()


def test_taking_a_place_while_its_folder_is_removed_makes_a_new_folder(tmp_path: Path) -> None:
    place = Place("Patrol", Fleeting(tmp_path))
    place.take()
    assert Fleeting.times == 2
    place.release()


def test_a_reader_gets_the_whole_plan_or_the_previous_one(tmp_path: Path) -> None:
    place = Place("Patrol", tmp_path)
    place.take()
    place.leave_plan("before")
    with place.plan.open() as reader:
        place.leave_plan("afterwards")
        assert (reader.read(), place.plan.read_text()) == ("before", "afterwards")
    place.release()
    assert list(tmp_path.rglob("*")) == []


def test_complaints_stay_if_there_are_any(tmp_path: Path) -> None:
    place = Place("Patrol", tmp_path)
    for text in ("Traceback", ""):
        place.take()
        place.complaints.write_text(text)
        place.release()
        assert place.complaints.exists() is bool(text)
    assert not place.folder.exists()


TAKE = """
import os, sys
from pathlib import Path
from robocomp_py.deploy.place import Place
Place("Patrol", Path(sys.argv[1])).take()
os._exit(0)
"""


@pytest.fixture
def killed(tmp_path: Path) -> int:
    """The id of who ran it, and was killed."""
    with subprocess.Popen([sys.executable, "-c", TAKE, str(tmp_path)]) as runner:
        return runner.pid


def test_cleaning_up_after_a_killed_network_does_not_register_as_its_runner(
    tmp_path: Path, killed: int, seen: list[Runner | None]
) -> None:
    Place("Patrol", tmp_path).clear()
    assert [runner and runner.pid for runner in seen] == [killed]
    assert not (tmp_path / "Patrol").exists()


@pytest.mark.parametrize("stands_there", ["it", "nothing"])
def test_a_lock_without_a_runner_is_waited_for(
    tmp_path: Path, killed: int, stands_there: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = tmp_path / "Patrol" / "pid"
    if stands_there == "nothing":
        lock.write_text("")
    asking = os.open(lock, os.O_RDONLY)
    fcntl.flock(asking, fcntl.LOCK_SH)
    pauses = iter(range(100))

    def pausing(seconds: float) -> None:
        if next(pauses) == 99:
            os.close(asking)

    monkeypatch.setattr(time, "sleep", pausing)
    place = Place("Patrol", tmp_path)
    place.take()
    place.release()
    assert list(pauses) == []


def test_a_held_lock_counts_whatever_its_file_contains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robocomp_py.deploy.place._TRIES_WITHOUT_RUNNER", 1)
    place = Place("Patrol", tmp_path)
    place.take()
    for text in ("", "nonsense", json.dumps({"pid": []})):
        (place.folder / "pid").write_text(text)
        assert Place("Patrol", tmp_path).runner() == Runner(0)
        with pytest.raises(AlreadyRuns, match="another process"):
            Place("Patrol", tmp_path).take()
    place.release()


def test_a_place_where_nothing_can_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DeploymentError, match="set ROBOCOMP_RUNTIME_DIR"):
        Place("Patrol", tmp_path / "file").take()


def test_names_become_files_of_one_folder() -> None:
    assert file_name("left/arm") == "left.arm"
    assert file_name("../../x") == "x"
    assert file_name("..") == "_"
    assert file_name("a b\n$(c)") == "a_b___c_"
