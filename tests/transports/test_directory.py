"""Who is there, also when processes die without saying goodbye."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from robocomp_py.errors import ConfigurationError, TransportError
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports import directory as directory_module
from robocomp_py.transports import membership
from robocomp_py.transports.directory import Directory
from robocomp_py.transports.inotify import Watch
from robocomp_py.transports.members import Entry
from robocomp_py.transports.runtime_folder import runtime_dir

LASER = Entry("serves", "robot/world/Laser/getLaserData", 1, "text", "ipc://laser")


@pytest.fixture
def directory(tmp_path: Path) -> Directory:
    return Directory(tmp_path / "transport")


def test_an_entry_that_could_not_be_announced_stays_hidden(
    directory: Directory, monkeypatch: pytest.MonkeyPatch
) -> None:
    member, other = directory.join("world"), replace(LASER, channel="robot/world/Other/op")
    member.add(LASER)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as crowded:
        crowded.setattr(os, "symlink", full)
        with pytest.raises(TransportError):
            member.add(other)
    told = json.loads((directory._folder / f"{member.id}.json").read_text())
    assert [entry["channel"] for entry in told["entries"]] == [LASER.channel]


def test_what_is_added_is_found_until_it_is_removed(directory: Directory) -> None:
    member = directory.join("world")
    member.add(LASER)
    wait_until(lambda: directory.find("serves", LASER.channel))
    ((found, entry),) = directory.find("serves", LASER.channel)
    assert (found.owner, found.pid, entry) == ("world", os.getpid(), LASER)
    assert not directory.find("calls", LASER.channel)
    member.remove(LASER)
    wait_until(lambda: not directory.find("serves", LASER.channel))
    member.close()


def test_a_star_stands_for_any_instance_on_either_side(directory: Directory) -> None:
    member = directory.join("world")
    member.add(LASER)
    wait_until(lambda: directory.find("serves", "robot/*/Laser/getLaserData"))
    assert not directory.find("serves", "other/*/Laser/getLaserData")
    anybody = Entry("subscribes", "robot/*/Laser/getLaserData", 1, "text")
    member.add(anybody)
    wait_until(lambda: directory.find("subscribes", LASER.channel))
    member.close()


def test_another_process_sees_it_and_what_a_killed_one_left_is_removed(directory: Directory, tmp_path: Path) -> None:
    code = f"""
import time
from pathlib import Path
from robocomp_py.transports.directory import Directory
from robocomp_py.transports.members import Entry
member = Directory(Path({str(tmp_path / "transport")!r})).join("victim")
member.add(Entry("serves", "a/b/c", 1, "text"))
member.address("socket").touch()
print("here", flush=True)
time.sleep(600)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as victim:
        try:
            assert victim.stdout is not None
            assert victim.stdout.readline() == b"here\n"
            wait_until(lambda: directory.find("serves", "a/b/c"))
            ((member, _),) = directory.find("serves", "a/b/c")
            assert directory.alive(member.id)
            victim.send_signal(signal.SIGSTOP)
            wait_until(lambda: not directory.responds(member, within=0.01))
            assert directory.alive(member.id)
            assert directory.responds(member, within=1000.0)
            victim.send_signal(signal.SIGCONT)
            wait_until(lambda: directory.responds(member, within=0.0))
        finally:
            victim.kill()
    assert not directory.alive(member.id)
    assert not directory.responds(member, within=1000.0)
    assert list((tmp_path / "transport").iterdir()) == []
    wait_until(lambda: not directory.find("serves", "a/b/c"))


def test_files_of_a_process_killed_while_joining_are_removed_by_the_next_member(
    directory: Directory, tmp_path: Path
) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    for name in (f"{dead.pid}-aa.lock", f"{dead.pid}-aa.draft", f"{os.getpid()}-bb.lock"):
        (tmp_path / "transport" / name).touch()
    member = directory.join("world")
    member.close()
    assert [path.name for path in (tmp_path / "transport").iterdir()] == [f"{os.getpid()}-bb.lock"]


def test_leaving_removes_everything(directory: Directory, tmp_path: Path) -> None:
    member = directory.join("world")
    member.add(LASER)
    member.address("socket").touch()
    member.close()
    member.close()
    assert list((tmp_path / "transport").iterdir()) == []


def test_files_of_other_versions_are_ignored(directory: Directory, tmp_path: Path) -> None:
    place = tmp_path / "transport" / "by" / "a.b"
    place.mkdir(parents=True)
    for name, text in (("1-a", "{}"), ("2-b", "half"), ("3-c", "[" * 100_000)):
        (tmp_path / "transport" / f"{name}.json").write_text(text)
        (place / name).symlink_to(f"../../{name}.json")
    assert directory.find("serves", "a/b/c") == []


def test_unknown_fields_are_ignored_and_an_invalid_record_hides_no_other(
    directory: Directory,
) -> None:
    ours, theirs, wrong = directory.join("ours"), directory.join("theirs"), directory.join("wrong")
    ours.add(LASER)
    told = {"role": "serves", "channel": LASER.channel, "fingerprint": 2, "text": "", "colour": "red"}
    for member, entry in ((theirs, told), (wrong, told | {"channel": 3})):
        record = {"owner": "it", "pid": os.getpid(), "entries": [entry], "more": 1}
        member.address("draft").write_text(json.dumps(record))
        member.address("draft").rename(directory._folder / f"{member.id}.json")
        if member is not ours:
            (directory._folder / "by" / "robot.world.Laser" / member.id).symlink_to(f"../../{member.id}.json")
    wait_until(lambda: {entry.fingerprint for _, entry in directory.find("serves", LASER.channel)} == {1, 2})
    for member in (ours, theirs, wrong):
        member.close()


def test_the_version_changes_when_members_do_and_only_then(directory: Directory) -> None:
    member = directory.join("world")
    member.add(LASER)
    wait_until(lambda: directory.find("serves", LASER.channel))
    before = directory.version()
    assert directory.version() == before
    member.remove(LASER)
    wait_until(lambda: directory.version() > before)
    member.close()


def test_the_run_time_folder_is_the_users_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path / "run"))
    assert stat.S_IMODE(runtime_dir().stat().st_mode) == 0o700
    (tmp_path / "run").chmod(0o755)
    with pytest.raises(ConfigurationError, match="open to other users"):
        runtime_dir()


def test_without_a_word_it_is_xdgs_or_a_folder_for_temporary_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROBOCOMP_RUNTIME_DIR")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert runtime_dir() == tmp_path / "robocomp"
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert runtime_dir() == tmp_path / f"robocomp-{os.getuid()}"


def test_a_folder_that_cannot_be_made_is_a_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path / "file" / "run"))
    with pytest.raises(ConfigurationError, match="set ROBOCOMP_RUNTIME_DIR"):
        runtime_dir()


def test_a_change_is_seen_even_if_the_clock_of_the_file_system_stood_still(directory: Directory) -> None:
    member = directory.join("world")
    member.add(replace(LASER, role="receives"))
    assert not directory.find("serves", LASER.channel)
    place = directory._folder / "by" / "robot.world.Laser"
    before = place.stat().st_mtime_ns
    member.add(LASER)
    os.utime(place, ns=(before, before))
    wait_until(lambda: directory.find("serves", LASER.channel))
    member.close()


def test_a_change_is_seen_even_if_a_thread_was_stopped_before_it_read_the_clock_of_the_file_system(
    directory: Directory, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 0.0
    stamp_of = directory_module._stamp_of_folder

    def stopped_before(folder: str) -> tuple[int, int]:
        nonlocal now
        now += 10.0
        monkeypatch.setattr(directory_module, "_stamp_of_folder", stamp_of)
        return stamp_of(folder)

    monkeypatch.setattr(directory_module, "time", SimpleNamespace(monotonic=lambda: now, time_ns=time.time_ns))
    member = directory.join("world")
    member.add(replace(LASER, role="calls"))
    place = directory._folder / "by" / "robot.world.Laser"
    before = place.stat().st_mtime_ns
    monkeypatch.setattr(directory_module, "_stamp_of_folder", stopped_before)
    assert not directory.find("serves", LASER.channel)
    assert not directory.find("serves", LASER.channel)
    member.add(LASER)
    os.utime(place, ns=(before, before))
    assert directory.find("serves", LASER.channel)
    member.close()


def test_no_two_versions_of_a_file_have_the_same_time(directory: Directory) -> None:
    member = directory.join("world")
    file = directory._folder / f"{member.id}.json"
    times = []
    for _ in range(20):
        member.add(LASER)
        times.append(file.stat().st_mtime_ns)
        member.remove(LASER)
    assert len(set(times)) == len(times)
    member.close()


def test_a_folder_that_was_removed_has_no_members_and_closing_does_not_care(directory: Directory) -> None:
    member = directory.join("world")
    member.add(LASER)
    wait_until(lambda: directory.find("serves", LASER.channel))
    shutil.rmtree(directory._folder)
    wait_until(lambda: not directory.find("serves", LASER.channel))
    assert not directory.alive(member.id)
    with pytest.raises(TransportError, match="cannot be written: No such file"):
        member.add(LASER)
    member.remove(LASER)
    member.close()


def _without_descriptors(folder: str) -> tuple[int, int]:
    raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), folder)


def test_what_could_not_be_looked_for_is_looked_for_again(
    directory: Directory, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    member = directory.join("world")
    member.add(LASER)
    with monkeypatch.context() as patch:
        patch.setattr(directory_module, "_stamp_of_folder", _without_descriptors)
        before = directory.version()
        for _ in range(3):
            assert not directory.find("serves", LASER.channel)
        assert directory.version() > before
    assert directory.find("serves", LASER.channel)
    assert sum("cannot be read" in record.message for record in caplog.records) == 1
    member.close()


def test_while_it_cannot_be_read_what_was_read_last_holds(
    directory: Directory, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    member = directory.join("world")
    member.add(LASER)
    wait_until(lambda: directory.find("serves", LASER.channel))
    with monkeypatch.context() as patch:
        patch.setattr(directory_module, "_stamp_of_folder", _without_descriptors)
        member.remove(LASER)
        for _ in range(3):
            assert directory.find("serves", LASER.channel)
        assert directory.alive(member.id)
    wait_until(lambda: not directory.find("serves", LASER.channel))
    assert sum("cannot be read" in record.message for record in caplog.records) == 1
    member.close()


@pytest.fixture
def watched(directory: Directory) -> Iterator[tuple[Directory, list[int]]]:
    """One that is told of changes, and the versions at which it said that there is news."""
    news: list[int] = []
    watch = Watch(directory._folder)
    directory.watch(watch, lambda: news.append(directory._version))
    yield directory, news
    watch.close()


def test_a_watcher_sees_members_arrive_change_and_leave(watched: tuple[Directory, list[int]]) -> None:
    directory, news = watched
    early = directory.join("early")
    early.add(LASER)
    assert [member.owner for member, _ in directory.find("serves", LASER.channel)] == ["early"]
    late = directory.join("late")
    assert len(directory.find("serves", LASER.channel)) == 1
    before = directory.version()
    late.add(LASER)
    assert len(directory.find("serves", LASER.channel)) == 2
    assert directory.version() > before
    early.remove(LASER)
    assert [member.owner for member, _ in directory.find("serves", LASER.channel)] == ["late"]
    late.close()
    assert not directory.find("serves", LASER.channel)
    assert news == sorted(set(news))
    assert news[-1] == directory.version()
    early.close()


def test_a_watcher_of_a_recreated_folder_finds_its_members(watched: tuple[Directory, list[int]]) -> None:
    directory, _ = watched
    member = directory.join("early")
    member.add(LASER)
    assert directory.find("serves", LASER.channel)
    shutil.rmtree(directory._folder)
    assert not directory.find("serves", LASER.channel)
    member.close()
    directory._folder.mkdir()
    member = directory.join("late")
    member.add(LASER)
    wait_until(lambda: [member.owner for member, _ in directory.find("serves", LASER.channel)] == ["late"])
    member.close()


def test_what_is_gathered_is_written_once_at_the_end(directory: Directory) -> None:
    member = directory.join("world")
    (file,) = directory._folder.glob("*.json")
    before = file.read_text()
    with member.gathered():
        member.add(LASER)
        with member.gathered():
            member.add(Entry("serves", "a/b/c", 2, "text"))
            member.remove(LASER)
        assert file.read_text() == before
    assert [entry["channel"] for entry in json.loads(file.read_text())["entries"]] == ["a/b/c"]
    member.close()


def test_what_is_of_no_interest_here_changes_no_version(directory: Directory) -> None:
    member = directory.join("world")
    wait_until(lambda: not directory.find("serves", LASER.channel))
    before = directory.version()
    member.add(Entry("serves", "robot/world/Camera/getImage", 1, "text"))
    assert directory.version() == before
    assert directory.find("serves", "robot/world/Camera/getImage")
    assert directory.version() == before
    member.close()


def test_a_wildcard_and_the_instances_that_it_covers_find_each_other(directory: Directory) -> None:
    world, other, anybody = (directory.join(name) for name in ("world", "other", "anybody"))
    world.add(LASER)
    other.add(replace(LASER, channel="robot/other/Laser/getLaserData"))
    anybody.add(Entry("calls", "robot/*/Laser/getLaserData", 1, "text"))
    for channel, found in ((LASER.channel, {"world"}), ("robot/*/Laser/getLaserData", {"world", "other"})):
        wait_until(lambda c=channel, f=found: {m.owner for m, _ in directory.find("serves", c)} == f)
        wait_until(lambda c=channel: [m.owner for m, _ in directory.find("calls", c)] == ["anybody"])
    assert not directory.find("calls", "robot/*/Camera/getLaserData")
    for each in (world, other, anybody):
        each.close()
    assert list(directory._folder.iterdir()) == []


def test_of_members_elsewhere_nothing_is_read(directory: Directory, monkeypatch: pytest.MonkeyPatch) -> None:
    crowd = [directory.join(f"member{number}") for number in range(5)]
    for number, member in enumerate(crowd):
        member.add(Entry("serves", f"robot/member{number}/Camera/getImage", 1, "text"))
    read: list[str] = []
    content = directory_module.content_of
    monkeypatch.setattr(directory_module, "content_of", lambda path: (read.append(Path(path).stem), content(path))[1])
    assert directory.find("serves", "robot/member3/Camera/getImage")
    assert not directory.find("serves", LASER.channel)
    assert read == [crowd[3].id]
    for member in crowd:
        member.close()


def test_a_file_that_is_in_many_places_is_read_once(directory: Directory, monkeypatch: pytest.MonkeyPatch) -> None:
    member = directory.join("world")
    entries = [replace(LASER, channel=f"robot/world/Sensor{number}/read") for number in range(5)]
    with member.gathered():
        for entry in entries:
            member.add(entry)
    read: list[str] = []
    content = directory_module.content_of
    monkeypatch.setattr(directory_module, "content_of", lambda path: (read.append(Path(path).stem), content(path))[1])
    assert all(directory.find("serves", entry.channel) for entry in entries)
    member.add(LASER)
    assert all(directory.find("serves", entry.channel) for entry in entries)
    assert len(read) == 2
    member.close()


def test_a_member_is_at_the_places_of_what_it_announces(directory: Directory) -> None:
    index = directory._folder / "by"
    member, other = directory.join("world"), directory.join("other")
    camera = Entry("serves", "robot/world/Camera/getImage", 1, "text")
    for entry in (LASER, camera, Entry("calls", "robot/*/Laser/getLaserData", 1, "text")):
        member.add(entry)
    other.add(LASER)

    def at(member_id: str) -> list[str]:
        return sorted(path.parent.name for path in index.glob(f"*/{member_id}"))

    lasers = ["robot.**.Laser", "robot.*.Laser", "robot.world.Laser"]
    assert at(member.id) == sorted([*lasers, "robot.**.Camera", "robot.world.Camera"])
    assert (index / "robot.world.Laser" / member.id).resolve() == directory._folder / f"{member.id}.json"
    member.remove(camera)
    assert at(member.id) == lasers
    assert not (index / "robot.world.Camera").exists()
    member.close()
    assert at(member.id) == []
    assert at(other.id) == ["robot.**.Laser", "robot.world.Laser"]
    other.close()
    assert list(directory._folder.iterdir()) == []


def test_an_entry_in_several_folders_is_current_in_all_of_them(watched: tuple[Directory, list[int]]) -> None:
    directory, _ = watched
    member = directory.join("world")
    anybody = Entry("serves", "robot/*/Laser/getLaserData", 1, "text")
    for changed, found in ((anybody, {anybody}), (LASER, {anybody, LASER})):
        member.add(changed)
        assert {entry for _, entry in directory.find("serves", LASER.channel)} == found
    member.remove(LASER)
    assert {entry for _, entry in directory.find("serves", LASER.channel)} == {anybody}
    member.close()


def test_what_could_not_be_shown_is_shown_the_next_time(directory: Directory, monkeypatch: pytest.MonkeyPatch) -> None:
    member = directory.join("world")
    with monkeypatch.context() as patch:
        patch.setattr(membership, "link_into", lambda *_: _without_descriptors("by"))
        with pytest.raises(TransportError, match="cannot be written"):
            member.add(LASER)
    other = replace(LASER, channel="robot/world/Laser/getConfiguration")
    member.add(other)
    assert [entry for _, entry in directory.find("serves", other.channel)] == [other]
    member.close()


def test_files_of_a_process_killed_while_leaving_are_removed_by_the_next_member(directory: Directory) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    place = directory._folder / "by" / "robot.world.Laser"
    place.mkdir(parents=True)
    (directory._folder / f"{dead.pid}-aa.json").write_text("{}")
    (place / f"{dead.pid}-aa").symlink_to(f"../../{dead.pid}-aa.json")
    directory.join("world").close()
    assert list(directory._folder.iterdir()) == []


def test_a_symlink_of_a_killed_process_is_removed_by_the_next_look(directory: Directory) -> None:
    member = directory.join("world")
    member.add(LASER)
    place = directory._folder / "by" / "robot.world.Laser"
    (place / "1-dead").symlink_to("../../1-dead.json")
    assert len(directory.find("serves", LASER.channel)) == 1
    assert [path.name for path in place.iterdir()] == [member.id]
    member.close()


def test_the_last_member_removes_all_symlinks_of_killed_processes(directory: Directory) -> None:
    member = directory.join("world")
    member.add(LASER)
    (directory._folder / "by" / "robot.**.Laser" / "1-dead").symlink_to("../../1-dead.json")
    member.close()
    assert list(directory._folder.iterdir()) == []


def test_names_too_long_for_a_file_are_found_too(directory: Directory) -> None:
    member = directory.join("world")
    long = replace(LASER, channel=f"robot/{'w' * 300}/Laser/getLaserData")
    member.add(long)
    assert [entry for _, entry in directory.find("serves", long.channel)] == [long]
    assert [entry for _, entry in directory.find("serves", "robot/*/Laser/getLaserData")] == [long]
    member.close()


def test_without_anything_that_tells_it_is_looked_again_after_a_pause(directory: Directory) -> None:
    assert not directory.find("serves", LASER.channel)
    assert 0 < directory.pause < 1


def test_a_watched_folder_is_not_polled(watched: tuple[Directory, list[int]]) -> None:
    directory, _ = watched
    assert not directory.find("serves", LASER.channel)
    assert directory.pause == 0
    shutil.rmtree(directory._folder / "by")
    directory.version()  # the place is watched again, as it is made again
    assert directory.pause == 0
    shutil.rmtree(directory._folder)
    directory.version()
    assert directory.pause > 0
