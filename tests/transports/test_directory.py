"""Who is there, also when processes die without saying goodbye."""

from __future__ import annotations

import json
import os
import shutil
import signal
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.errors import ConfigurationError, TransportError
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.directory import Directory, Entry, runtime_dir
from robocomp_py.transports.inotify import FolderWatch

LASER = Entry("serves", "robot/world/Laser/getLaserData", 1, "text", "ipc://laser")


@pytest.fixture
def directory(tmp_path: Path) -> Directory:
    return Directory(tmp_path / "transport")


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
from robocomp_py.transports.directory import Directory, Entry
member = Directory(Path({str(tmp_path / "transport")!r})).join("victim")
member.add(Entry("serves", "a/b/c", 1, "text"))
member.address("socket").touch()
print("here", flush=True)
time.sleep(600)
"""
    victim = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
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
    victim.kill()
    victim.wait()
    victim.stdout.close()
    assert not directory.alive(member.id)
    assert not directory.responds(member, within=1000.0)
    assert list((tmp_path / "transport").iterdir()) == []
    wait_until(lambda: not directory.find("serves", "a/b/c"))


def test_what_one_left_who_was_killed_while_it_joined_is_removed_by_the_next_one(
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
    (tmp_path / "transport" / "1-a.json").write_text("{}")
    (tmp_path / "transport" / "2-b.json").write_text("half")
    assert directory.find("serves", "a/b/c") == []


def test_of_what_another_program_wrote_the_unknown_is_passed_over_and_the_wrong_hides_nobody(
    directory: Directory,
) -> None:
    ours, theirs, wrong = directory.join("ours"), directory.join("theirs"), directory.join("wrong")
    ours.add(LASER)
    told = {"role": "serves", "channel": LASER.channel, "fingerprint": 2, "text": "", "colour": "red"}
    for member, entry in ((theirs, told), (wrong, told | {"channel": 3})):
        record = {"owner": "it", "pid": os.getpid(), "entries": [entry], "more": 1}
        member.address("draft").write_text(json.dumps(record))
        member.address("draft").rename(directory._folder / f"{member.id}.json")
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
    (file,) = directory._folder.glob("*.json")
    before = file.stat().st_mtime_ns
    assert not directory.find("serves", LASER.channel)
    member.add(LASER)
    os.utime(file, ns=(before, before))
    wait_until(lambda: directory.find("serves", LASER.channel))
    member.close()


def test_a_change_that_nobody_looked_for_in_a_while_is_seen_even_if_the_clock_stood_still(directory: Directory) -> None:
    member = directory.join("world")
    before = directory._folder.stat().st_mtime_ns
    assert not directory.find("serves", LASER.channel)
    member.add(LASER)
    os.utime(directory._folder, ns=(before, before))
    directory._changed_at -= 1000.0
    assert directory.find("serves", LASER.channel)
    member.close()


def test_what_could_not_be_looked_into_is_looked_for_again(
    directory: Directory, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    member = directory.join("world")
    member.add(LASER)
    wait_until(lambda: (directory.version(), directory._settled)[1])
    directory._remembers, directory._asked_at = True, 0.0
    directory.version()  # which forgets what nobody has looked for
    with monkeypatch.context() as patch:
        patch.setattr(directory, "_folder", directory._folder / ("x" * 300))  # a name too long for any file system
        before = directory.version()
        assert not directory.find("serves", LASER.channel)
        assert directory.version() > before
    assert directory.find("serves", LASER.channel)
    assert sum("cannot be read" in record.message for record in caplog.records) == 1
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


def test_while_it_cannot_be_read_what_was_read_last_holds(
    directory: Directory, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    member = directory.join("world")
    member.add(LASER)
    wait_until(lambda: directory.find("serves", LASER.channel))
    folder = directory._folder
    with monkeypatch.context() as patch:
        patch.setattr(directory, "_folder", folder / ("x" * 300))  # a name too long for any file system
        member.remove(LASER)
        for _ in range(3):
            assert directory.find("serves", LASER.channel)
        assert directory.alive(member.id)
    wait_until(lambda: not directory.find("serves", LASER.channel))
    assert sum("cannot be read" in record.message for record in caplog.records) == 1
    member.close()


def test_members_of_no_interest_are_not_read(directory: Directory) -> None:
    member, other = directory.join("world"), directory.join("camera")
    member.add(LASER)
    other.add(Entry("serves", "robot/world/Camera/getImage", 1, "text"))
    assert directory.find("serves", LASER.channel)
    assert {name: file.raw is not None for name, file in directory._files.items()} == {member.id: True, other.id: False}
    for each in (member, other):
        each.close()


def test_what_a_file_is_about_follows_what_is_in_it(directory: Directory) -> None:
    member = directory.join("world")
    camera, laser = Entry("serves", "robot/world/Camera/getImage", 1, "text"), directory._folder / f"{member.id}.about"
    for entry in (LASER, camera, Entry("calls", "robot/*/Laser/getLaserData", 1, "text")):
        member.add(entry)
    assert os.readlink(laser) == "robot/*/Laser/ robot/world/Camera/ robot/world/Laser/"
    member.remove(LASER)
    assert directory.find("calls", "robot/other/Laser/getLaserData")
    assert not directory.find("serves", LASER.channel)
    assert os.readlink(laser) == "robot/*/Laser/ robot/world/Camera/"
    member.close()


def test_a_file_that_is_about_very_much_is_read_by_everybody(directory: Directory) -> None:
    member = directory.join("world")
    with member.gathered():
        for number in range(300):
            member.add(Entry("serves", f"robot/instance_{number}/Laser/getLaserData", 1, "text"))
    assert directory.find("serves", "robot/instance_200/Laser/getLaserData")
    assert not list(directory._folder.glob("*.about"))
    member.close()


@pytest.fixture
def watched(directory: Directory) -> Iterator[tuple[Directory, list[int]]]:
    """One that is told of changes, and the versions at which it said that there is news."""
    news: list[int] = []
    watch = FolderWatch(directory._folder)
    directory.heed(watch, lambda: news.append(directory._version))
    yield directory, news
    watch.close()


def test_who_watches_finds_who_comes_changes_and_goes(watched: tuple[Directory, list[int]]) -> None:
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


def test_who_watches_reads_nothing_but_what_has_changed(
    watched: tuple[Directory, list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    directory, _ = watched
    crowd = [directory.join(f"member{number}") for number in range(5)]
    assert not directory.find("serves", LASER.channel)
    with monkeypatch.context() as patch:
        patch.delattr(directory.__class__, "_read")
        crowd[3].add(LASER)
        assert directory.find("serves", LASER.channel)
    for member in crowd:
        member.close()


def test_who_was_not_told_of_everything_looks_at_everybody_also_at_many(
    watched: tuple[Directory, list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, seconds in (("_LEAST", 1.0), ("_LONGEST_PAUSE", 0.0)):  # as among many more
        monkeypatch.setattr(f"robocomp_py.transports.directory.{name}", seconds)
    directory, _ = watched
    crowd = [directory.join(f"member{number}") for number in range(40)]
    for number, member in enumerate(crowd):
        member.add(Entry("serves", f"robot/member{number}/Camera/getImage", 1, "text"))
    assert not directory.find("serves", LASER.channel)
    crowd[20].add(LASER)
    assert directory._watch is not None
    directory._watch.changed()
    directory._watch.forget()  # as if there had been too much to tell
    wait_until(lambda: directory.find("serves", LASER.channel))
    for member in crowd:
        member.close()


def test_who_watches_a_folder_that_was_made_again_finds_who_is_there(watched: tuple[Directory, list[int]]) -> None:
    directory, _ = watched
    member = directory.join("early")
    member.add(LASER)
    assert directory.find("serves", LASER.channel)
    shutil.rmtree(directory._folder)
    assert not directory.find("serves", LASER.channel)
    member.close()
    directory._folder.mkdir()
    assert directory._watch is not None
    directory._watch.renew()
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


def test_among_many_members_one_is_found_too(directory: Directory) -> None:
    crowd = [directory.join(f"member{number}") for number in range(40)]
    assert not directory.find("serves", LASER.channel)
    assert directory.pause > 0
    crowd[20].add(LASER)
    wait_until(lambda: directory.find("serves", LASER.channel))
    ((found, _),) = directory.find("serves", LASER.channel)
    assert found.owner == "member20"
    crowd[20].close()
    wait_until(lambda: not directory.find("serves", LASER.channel))
    for member in crowd:
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


def test_a_channel_that_another_program_wrote_with_escapes_is_found(directory: Directory) -> None:
    member = directory.join("theirs")
    channel = LASER.channel.replace("/", "\\/").replace("world", "\\u0077orld")
    text = f'{{"owner": "it", "pid": {os.getpid()}, "entries": [{{"role": "serves", "channel": "{channel}", '
    member.address("draft").write_text(text + '"fingerprint": 1, "text": ""}]}')
    member.address("draft").rename(directory._folder / f"{member.id}.json")
    wait_until(lambda: directory.find("serves", LASER.channel))
    member.close()
