"""What only one on this host may have: a channel that is served, a router that is run.

A claim is a locked file in the run-time folder. The kernel releases it when its process ends,
however that happens; the file says who holds it, for messages to people. What killed processes left
in a folder is removed when a process claims its first name there.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import re
import threading
import time
from pathlib import Path

from ..errors import AlreadyServed, TransportError

_LONGEST = 200
"""File names may have 255 bytes; longer ones are shortened to so many, with a digest of the whole."""

_PID = re.compile(r"\(pid (\d{1,9})\)$")

_SIGNING, _REMOVING = 3.0, 1.0
"""Seconds for which whoever has just locked a file may not have signed it yet, or removed it, if the signature is one
of the dead (or of somebody in another container): it may be held up."""

_LONGEST_PAUSE = 0.02
"""Seconds between two attempts meanwhile."""

SWEPT = "swept"
"""The name of the mark of a folder with many files; see `is_swept`."""
_MANY = 200
_WHILE = 10.0
"""Seconds within which a folder with many files is looked through once."""


class Claim:
    """Held until it is closed, or its process has ended."""

    def __init__(self, path: Path, held: int) -> None:
        self._path, self._held = path, held
        self._lock = threading.Lock()

    def close(self) -> None:
        """Give it back. Idempotent."""
        with self._lock:
            held, self._held = self._held, -1
        if held < 0:
            return
        with contextlib.suppress(OSError):  # a file that stays, but is not locked, means nothing
            if _is(self._path, held):  # else the folder was removed, and this file is another's
                self._path.unlink()  # while it is locked: nobody else can have claimed it meanwhile
        os.close(held)


def claim(folder: Path, name: str, owner: str) -> Claim:
    """Have `name` to ourselves. Raises AlreadyServed, naming who has it, if somebody does."""
    if folder not in _swept:
        _swept.add(folder)
        sweep(folder)
    begun, pause = time.monotonic(), 0.001
    while (claimed := try_claim(folder, name, owner)) is None:
        who = _signature(folder, name)
        settled = bool(who) and not is_gone(_pid(who))  # else it has not been signed yet, or is just being removed
        if settled or time.monotonic() - begun >= (_REMOVING if who else _SIGNING):
            raise AlreadyServed(f"{name}: already served by {who or holder(folder, name)}")
        time.sleep(pause)
        pause = min(2 * pause, _LONGEST_PAUSE)
    return claimed


_swept: set[Path] = set()
"""Folders that this process has looked through."""


def sweep(folder: Path) -> None:
    """Remove the files of processes that ended without giving back what they had claimed."""
    if is_swept(folder):
        return
    with contextlib.suppress(OSError):
        left = [name for name in os.listdir(folder) if name.endswith(".lock")]
        mark_swept(folder, len(left))
        for name in left:
            with contextlib.suppress(OSError):  # what cannot be removed now means nothing, and is removed another time
                _remove_left(folder / name)


def is_swept(folder: Path) -> bool:
    """Whether somebody has just looked through a folder with many files: one of all is enough."""
    with contextlib.suppress(OSError):
        return time.time() - (folder / SWEPT).stat().st_mtime < _WHILE
    return False


def mark_swept(folder: Path, files: int) -> None:
    """Say that a folder with so many files is looked through now."""
    if files > _MANY:
        (folder / SWEPT).touch()


def _remove_left(path: Path) -> None:
    if not is_gone(_pid(path.read_text(errors="replace"))):
        return
    held = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:  # somebody claims it just now, or has an id that we cannot see
        os.close(held)
    else:
        Claim(path, held).close()


def is_gone(pid: int) -> bool:
    """Whether there is no process of this id, as far as we can see. Containers do not see each other's."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return pid > 0
    except PermissionError:
        return False
    return False


def try_claim(folder: Path, name: str, owner: str) -> Claim | None:
    """Have `name` to ourselves, or None if somebody else has it. Never waits."""
    path = _file(folder, name)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        while True:
            held = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
            try:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if _is(path, held):
                    os.ftruncate(held, 0)
                    os.pwrite(held, f"{owner or 'somebody'} (pid {os.getpid()})".encode(), 0)
                    return Claim(path, held)
            except BlockingIOError:
                os.close(held)
                return None
            except BaseException:
                os.close(held)
                raise
            os.close(held)  # who had it removed the file between our two steps
    except OSError as exc:
        raise TransportError(f"{name}: cannot be claimed in {folder}: {exc.strerror}") from exc


def is_claimed(folder: Path, name: str) -> bool:
    """False if `name` was given back. Still true if who had it was killed, or if the folder was removed."""
    return os.path.exists(_file(folder, name)) or not os.path.exists(folder)


def holder(folder: Path, name: str) -> str:
    """Who has claimed `name`, in words."""
    return _signature(folder, name) or "somebody who just came or left"


def _signature(folder: Path, name: str) -> str:
    """What stands in the file: nothing yet, for a moment after it was locked, and nothing any more once it has gone."""
    with contextlib.suppress(OSError):
        return _file(folder, name).read_text(errors="replace")
    return ""


def _pid(signature: str) -> int:
    """Whose signature it is; 0 if it is nobody's."""
    found = _PID.search(signature)
    return int(found[1]) if found else 0


def _file(folder: Path, name: str) -> Path:
    return folder / f"{file_name(name)}.lock"


def file_name(name: str) -> str:
    """How a channel, or the beginning of one, is written as the name of a file."""
    plain = name.replace("/", ".")  # segments of channels contain no dots
    if len(plain.encode()) > _LONGEST:
        plain = f"{plain[: _LONGEST // 2]}-{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    return plain


def _is(path: Path, held: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(held))
    except FileNotFoundError:
        return False
