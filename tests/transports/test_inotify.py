"""Being told when a folder changes."""

from __future__ import annotations

import contextlib
import os
import resource
import select
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.testing.patience import SOON
from robocomp_py.transports.inotify import Watch


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "watched"
    path.mkdir()
    return path


@pytest.fixture
def watch(folder: Path) -> Iterator[Watch]:
    opened = Watch(folder)
    opened.add(str(folder))
    yield opened
    opened.close()


def told(watch: Watch, within: float = SOON) -> bool:
    """Whether there is something to be read; then it is."""
    poller = select.poll()
    poller.register(watch.fileno, select.POLLIN)
    found = bool(poller.poll(within * 1000))
    watch.read()
    return found


def put(folder: Path, name: str) -> None:
    (folder / "draft").write_text("x")
    (folder / "draft").rename(folder / name)


def test_created_removed_and_replaced_files_are_reported_and_a_touched_folder(folder: Path, watch: Watch) -> None:
    assert not told(watch, 0)
    put(folder, "file")
    assert told(watch)
    put(folder, "file")
    assert told(watch)
    (folder / "file").unlink()
    assert told(watch)
    (folder / "link").symlink_to("file")
    assert told(watch)
    watch.changed()
    assert not told(watch, 0)
    os.utime(folder)
    assert told(watch)
    assert watch.watches(str(folder))


def test_the_changed_folders_are_reported(folder: Path, watch: Watch) -> None:
    others = [folder.with_name(name) for name in ("one", "two", "unwatched")]
    for other in others:
        other.mkdir()
    for other in others[:2]:
        watch.add(str(other))
    assert watch.changed() == set()
    for other in others[1:]:
        put(other, "file")
    assert watch.changed() == {str(others[1])}
    put(folder, "file")
    watch.read()
    put(others[0], "file")
    assert watch.changed() == {str(folder), str(others[0])}
    assert watch.changed() == set()


def test_an_overflow_reports_all_folders_as_changed(folder: Path, watch: Watch) -> None:
    other = folder.with_name("other")
    other.mkdir()
    watch.add(str(other))
    most = int(Path("/proc/sys/fs/inotify/max_queued_events").read_text())
    (folder / "0").write_text("x")
    for number in range(most + 1):
        (folder / f"{number}").rename(folder / f"{number + 1}")
    assert watch.changed() == {str(folder), str(other)}
    assert not watch.watches(str(folder))  # that it has gone may have been among it
    watch.add(str(folder))
    put(folder, "file")
    assert watch.changed() == {str(folder)}


def test_a_removed_folder_is_reported_and_not_watched_until_added_again(folder: Path, watch: Watch) -> None:
    folder.rmdir()
    assert told(watch)
    assert watch.changed() == {str(folder)}
    assert not watch.watches(str(folder))
    watch.add(str(folder))
    assert not watch.watches(str(folder))
    folder.mkdir()
    watch.add(str(folder))
    assert watch.watches(str(folder))
    put(folder, "file")
    assert told(watch)


@contextlib.contextmanager
def no_descriptors() -> Iterator[None]:
    _, most = limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def test_many_failing_watches_are_logged_once_in_a_while(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    def told_by_three() -> int:
        caplog.clear()
        for _ in range(3):
            Watch(folder).close()
        return len(caplog.records)

    (folder / "unwatched").touch()
    with no_descriptors():
        assert told_by_three() == 0
        os.utime(folder / "unwatched", (0, 0))
        assert told_by_three() == 1


def test_without_a_descriptor_nothing_is_reported_and_nothing_fails(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with no_descriptors():
        watch = Watch(folder)
    assert "max_user_instances" in caplog.text
    watch.add(str(folder))
    assert not watch.read()
    assert watch.changed() == set()
    assert not watch.watches(str(folder))
    watch.close()


def test_closing_may_be_repeated(folder: Path, watch: Watch) -> None:
    watch.close()
    watch.close()
    assert not watch.read()
    watch.add(str(folder))
    assert not watch.watches(str(folder))
