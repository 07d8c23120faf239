"""Folders that belong to one user alone, checked so that no other user can exchange them.

Each folder is opened once, without following a symbolic link at its end, and the open descriptor is checked. Its
subfolders are opened relative to that descriptor. The paths stay safe to use afterwards: in a folder with mode 0700
only its owner and root can create or exchange anything, and a parent that other users may write to has to be sticky.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

_FOLDER = os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
"""O_PATH needs no permission to read, so it also reveals the owner of an unreadable folder."""


class NotOurs(Exception):
    """A folder cannot be used. The text names the obstacle, its owner and the remedy."""


def make_private(folder: Path, below: tuple[str, ...]) -> None:
    """Make a folder with mode 0700 if it is missing, and check it. Also check its subfolder `below`, if that exists.

    A missing subfolder is not made: only our user (and root) can make it afterwards.
    Raises NotOurs, or OSError if the folder cannot be made.
    """
    with contextlib.suppress(FileExistsError):
        _make(folder)
    with _opened(folder, folder) as top:
        _check_owner(folder, top)
        if mode := stat.S_IMODE(os.fstat(top).st_mode) & 0o077:
            raise NotOurs(f"is open to other users (they have mode {mode:03o}); run: chmod 700 {folder}")
        _check_parent(folder)
        with contextlib.ExitStack() as opened:
            path, above = folder, top
            for name in below:
                path /= name
                try:
                    above = opened.enter_context(_opened(name, path, above))
                except FileNotFoundError:
                    return
                _check_owner(path, above)


def _make(folder: Path) -> None:
    missing = [each for each in folder.parents if not each.exists()]
    for each in reversed(missing):
        with contextlib.suppress(FileExistsError):
            os.mkdir(each, 0o755)  # whatever the umask is, other users must not write there
    os.mkdir(folder, 0o700)


@contextlib.contextmanager
def _opened(name: str | Path, path: Path, above: int | None = None) -> Iterator[int]:
    try:
        opened = os.open(name, _FOLDER, dir_fd=above)
    except OSError as exc:
        if exc.errno not in (errno.ENOTDIR, errno.ELOOP):
            raise
        raise NotOurs(_in_the_way(name, path, above)) from exc
    try:
        yield opened
    finally:
        os.close(opened)


def _in_the_way(name: str | Path, path: Path, above: int | None) -> str:
    """What is there instead of a folder, for the message only: it may have changed since."""
    info = os.stat(name, dir_fd=above, follow_symlinks=False)
    if not stat.S_ISLNK(info.st_mode):
        return f"needs a folder, and {path} is a file of {_user(info.st_uid)}; {_moving(info.st_uid, path)}"
    target = os.readlink(name, dir_fd=above)
    return (
        f"needs a folder, and {path} is a symbolic link to {target}, made by {_user(info.st_uid)}; "
        f"{_moving(info.st_uid, path)}"
    )


def _check_owner(path: Path, opened: int) -> None:
    owner = os.fstat(opened).st_uid
    if owner != os.getuid():
        raise NotOurs(
            f"has to belong to {_user(os.getuid())}, and {path} belongs to {_user(owner)}; {_moving(owner, path)}"
        )


def _check_parent(folder: Path) -> None:
    """Raises NotOurs if any user may rename the folder and so exchange it after the check."""
    parent = folder.resolve().parent
    mode = parent.stat().st_mode
    if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
        raise NotOurs(
            f"can be exchanged by any user, for {parent} is open to all and not sticky; run: chmod +t {parent}"
        )


def _moving(owner: int, path: Path) -> str:
    """Never to remove it: a setting may name a wrong path."""
    return f"move it away ({'' if owner == os.getuid() else 'sudo '}mv {path} {path}.old)"


def _user(uid: int) -> str:
    import pwd

    try:
        return f"user {pwd.getpwuid(uid).pw_name} (uid {uid})"
    except KeyError:
        return f"the user with uid {uid}"
