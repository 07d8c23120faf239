"""The run-time folder and its subfolders: no other user can put something else in their place."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from robocomp_py.deploy.place import Place
from robocomp_py.errors import ConfigurationError, DeploymentError
from robocomp_py.transports import owned
from robocomp_py.transports.runtime_folder import runtime_dir


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path / "run"))
    return tmp_path / "run"


def test_a_symbolic_link_to_a_private_folder_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(
        ConfigurationError, match=rf"{folder} is a symbolic link to {tmp_path}/elsewhere, made by .*; move it away"
    ):
        runtime_dir()
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_link_above_the_folder_is_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path / "link" / "run"))
    assert runtime_dir() == tmp_path / "link" / "run"


def test_a_file_in_the_way_is_named(folder: Path) -> None:
    folder.touch()
    with pytest.raises(
        ConfigurationError, match=rf"{folder} is a file of user .*; move it away \(mv {folder} {folder}.old\)"
    ):
        runtime_dir()


def test_a_subfolder_is_checked_and_not_made(folder: Path, tmp_path: Path) -> None:
    assert runtime_dir("zeromq", "served") == folder / "zeromq" / "served"
    assert not list(folder.iterdir())
    (folder / "zeromq").symlink_to(tmp_path)
    with pytest.raises(ConfigurationError, match=rf"{folder}/zeromq is a symbolic link to {tmp_path}"):
        runtime_dir("zeromq", "served")


def test_the_folder_of_a_network_is_checked(folder: Path, tmp_path: Path) -> None:
    (runtime_dir() / "deploy").mkdir()
    (folder / "deploy" / "home").symlink_to(tmp_path)
    with pytest.raises(DeploymentError, match=f"{folder}/deploy/home is a symbolic link"):
        Place("home")


def test_the_owner_of_a_subfolder_is_checked_and_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inner = runtime_dir() / "shm"
    inner.mkdir()
    node, real = inner.stat().st_ino, os.fstat

    def fstat(opened: int) -> os.stat_result:  # only root can give a folder to another user
        info = real(opened)
        return os.stat_result((*info[:4], 54321, *info[5:])) if info.st_ino == node else info

    monkeypatch.setattr(os, "fstat", fstat)
    with pytest.raises(
        ConfigurationError,
        match=rf"{inner} belongs to the user with uid 54321; move it away \(sudo mv {inner} {inner}.old\)",
    ):
        runtime_dir("shm")
    assert runtime_dir() == folder


def test_what_is_checked_is_what_was_opened(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A link that takes the place of the folder between its making and its check is not followed."""
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    real = owned._make

    def exchanged(made: Path) -> None:
        real(made)
        made.rmdir()
        made.symlink_to(tmp_path / "elsewhere")

    monkeypatch.setattr(owned, "_make", exchanged)
    with pytest.raises(ConfigurationError, match="is a symbolic link"):
        runtime_dir()


def test_a_parent_in_which_any_user_may_rename_it_is_refused(folder: Path, tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    with pytest.raises(ConfigurationError, match=rf"chmod \+t {tmp_path}"):
        runtime_dir()
    tmp_path.chmod(0o1777)
    assert runtime_dir() == folder


def test_parents_are_made_so_that_others_cannot_write_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path / "above" / "run"))
    before = os.umask(0)
    try:
        runtime_dir()
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "above").stat().st_mode) == 0o755
