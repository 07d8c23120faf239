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
from robocomp_py.transports.inotify import FolderWatch


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "watched"
    path.mkdir()
    return path


@pytest.fixture
def watch(folder: Path) -> Iterator[FolderWatch]:
    opened = FolderWatch(folder)
    yield opened
    opened.close()


def told(watch: FolderWatch, within: float = SOON) -> bool:
    """Whether there is something to be read; then it is."""
    poller = select.poll()
    poller.register(watch.fileno, select.POLLIN)
    found = bool(poller.poll(within * 1000))
    watch.read()
    return found


def put(folder: Path, name: str) -> None:
    (folder / "draft").write_text("x")
    (folder / "draft").rename(folder / name)


def test_files_that_come_go_or_are_replaced_are_told(folder: Path, watch: FolderWatch) -> None:
    assert not told(watch, 0)
    put(folder, "file.json")
    assert told(watch)
    put(folder, "file.json")
    assert told(watch)
    (folder / "file.json").unlink()
    assert told(watch)
    assert not told(watch, 0)
    assert watch.working


def test_files_on_their_way_wake_nobody(folder: Path, watch: FolderWatch) -> None:
    (folder / "draft").write_text("x")
    assert not told(watch, 0)


def test_first_anything_may_have_changed_and_then_what_is_told(folder: Path, watch: FolderWatch) -> None:
    assert watch.changed() is None
    assert watch.changed() == set()
    for name in ("a.json", "b.json", "c.lock", "a.json"):
        put(folder, name)
    (folder / "b.json").unlink()
    assert watch.changed() == {"a", "b"}
    put(folder, "c.json")
    watch.read()
    assert watch.changed() == {"c"}
    assert watch.changed() == set()
    watch.forget()
    assert watch.changed() is None
    assert watch.changed() == set()


def test_what_is_too_much_to_be_told_may_be_anything(folder: Path, watch: FolderWatch) -> None:
    watch.changed()
    most = int(Path("/proc/sys/fs/inotify/max_queued_events").read_text())
    (folder / "0.json").write_text("x")
    for number in range(most + 1):
        (folder / f"{number}.json").rename(folder / f"{number + 1}.json")
    assert watch.changed() is None
    put(folder, "file.json")
    assert watch.changed() == {"file"}


@pytest.mark.parametrize("how", ["removed", "renamed"])
def test_of_a_folder_that_went_nothing_is_told_until_the_watch_is_renewed(
    folder: Path, watch: FolderWatch, how: str
) -> None:
    folder.rmdir() if how == "removed" else folder.rename(folder.with_name("elsewhere"))
    assert told(watch)
    assert not watch.working
    watch.renew()
    assert not watch.working
    folder.mkdir()
    watch.renew()
    assert watch.working
    assert watch.changed() is None
    put(folder, "file.json")
    assert told(watch)


@contextlib.contextmanager
def no_descriptors() -> Iterator[None]:
    _, most = limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def test_of_many_who_cannot_watch_a_folder_one_says_it_once_in_a_while(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def told_by_three() -> int:
        caplog.clear()
        for _ in range(3):
            FolderWatch(folder).close()
        return len(caplog.records)

    (folder / "unwatched").touch()
    with no_descriptors():
        assert told_by_three() == 0
        os.utime(folder / "unwatched", (0, 0))
        assert told_by_three() == 1


def test_without_a_descriptor_nothing_is_told_and_nothing_fails(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    with no_descriptors():
        watch = FolderWatch(folder)
    assert "max_user_instances" in caplog.text
    watch.renew()
    watch.read()
    assert not watch.working
    watch.close()


def test_closing_may_be_repeated(watch: FolderWatch) -> None:
    watch.close()
    watch.close()
    watch.read()
    watch.renew()
    assert not watch.working
