"""Being told when a folder changes."""

from __future__ import annotations

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


def test_files_that_come_go_or_are_replaced_are_told(folder: Path, watch: FolderWatch) -> None:
    assert not told(watch, 0)
    (folder / "draft").write_text("x")
    assert told(watch)
    (folder / "draft").rename(folder / "file")
    assert told(watch)
    (folder / "file").unlink()
    assert told(watch)
    assert not told(watch, 0)
    assert watch.working


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
    (folder / "file").write_text("x")
    assert told(watch)


def test_without_a_descriptor_nothing_is_told_and_nothing_fails(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    _, most = limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, most))
    try:
        watch = FolderWatch(folder)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
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
