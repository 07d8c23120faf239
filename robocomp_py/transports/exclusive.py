"""Claims: the right to serve a channel, or to run a router, exclusively on this host.

A claim is a locked file in the run-time folder. The kernel releases it when its process ends,
however it ends. The file names the holder, for messages to people. When a process claims its first
name in a folder, it removes the files of killed processes there.
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
"""Maximum bytes of a name; a longer one is shortened, with a digest of the whole. File names may have 255 bytes."""

_PID = re.compile(r"\(pid (\d{1,9})\)$")

_SIGNING, _REMOVING = 3.0, 1.0
"""Seconds to wait for another process that has locked a file: until it has signed it, and until it has removed a file
with the signature of a dead process (or of one in another container)."""

_LONGEST_PAUSE = 0.02
"""Maximum seconds between two attempts meanwhile."""

SWEPT = "swept"
"""The file that marks a folder with many files as swept; see `is_swept`."""
_MANY = 200
_WHILE = 10.0
"""Seconds within which only one process sweeps a folder with many files."""


class Claim:
    """A claim. It is held until it is closed or its process ends."""

    def __init__(self, path: Path, held: int) -> None:
        self._path, self._held = path, held
        self._lock = threading.Lock()

    def close(self) -> None:
        """Give it back. Idempotent."""
        with self._lock:
            held, self._held = self._held, -1
        if held < 0:
            return
        with contextlib.suppress(OSError):  # a file that stays without a lock is harmless
            if _is(self._path, held):  # else the folder was removed, and the file belongs to another process
                self._path.unlink()  # while it is locked, so that no other process can claim it meanwhile
        os.close(held)


def claim(folder: Path, name: str, owner: str) -> Claim:
    """Claim `name`. Raises AlreadyServed, which names the holder, if it is claimed already."""
    if folder not in _swept:
        _swept.add(folder)
        sweep(folder)
    begun, pause = time.monotonic(), 0.001
    while (claimed := try_claim(folder, name, owner)) is None:
        signature = _signature(folder, name)
        settled = bool(signature) and not is_gone(_pid(signature))  # else it is just being signed or removed
        if settled or time.monotonic() - begun >= (_REMOVING if signature else _SIGNING):
            raise AlreadyServed.by(name, signature or holder(folder, name))
        time.sleep(pause)
        pause = min(2 * pause, _LONGEST_PAUSE)
    return claimed


_swept: set[Path] = set()
"""Folders that this process has swept."""


def sweep(folder: Path) -> None:
    """Remove the files of processes that ended without releasing their claims."""
    if is_swept(folder):
        return
    with contextlib.suppress(OSError):
        left = [name for name in os.listdir(folder) if name.endswith(".lock")]
        mark_swept(folder, len(left))
        for name in left:
            with contextlib.suppress(OSError):  # a file that stays is harmless, and is removed later
                _remove_left(folder / name)


def left_in(folder: Path) -> list[str]:
    """The claims of processes that ended without releasing them. Raises OSError."""
    return [
        name
        for name in os.listdir(folder)
        if name.endswith(".lock") and is_gone(_pid((folder / name).read_text(errors="replace")))
    ]


def is_swept(folder: Path) -> bool:
    """Whether a process has just swept a folder with many files: one sweep is enough for all."""
    with contextlib.suppress(OSError):
        return time.time() - (folder / SWEPT).stat().st_mtime < _WHILE
    return False


def mark_swept(folder: Path, files: int) -> None:
    """Note that a folder with `files` files is swept now."""
    if files > _MANY:
        (folder / SWEPT).touch()


def _remove_left(path: Path) -> None:
    if not is_gone(_pid(path.read_text(errors="replace"))):
        return
    held = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:  # another process claims it just now, or has an id that is not visible here
        os.close(held)
    else:
        Claim(path, held).close()


def is_gone(pid: int) -> bool:
    """Whether no visible process has this id. Containers do not see each other's processes."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return pid > 0
    except PermissionError:
        return False
    return False


def try_claim(folder: Path, name: str, owner: str) -> Claim | None:
    """Claim `name`; None if another process holds it. Never waits."""
    path = _file(folder, name)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        while True:
            held = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
            try:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if _is(path, held):
                    os.ftruncate(held, 0)
                    os.pwrite(held, f"{owner or 'an unnamed process'} (pid {os.getpid()})".encode(), 0)
                    return Claim(path, held)
            except BlockingIOError:
                os.close(held)
                return None
            except BaseException:
                os.close(held)
                raise
            os.close(held)  # its last holder removed the file between our two steps
    except OSError as exc:
        raise TransportError(f"{name}: cannot be claimed in {folder}: {exc.strerror}") from exc


def is_claimed(folder: Path, name: str) -> bool:
    """False if the claim of `name` was released. Still true if its holder was killed, or the folder was removed."""
    return os.path.exists(_file(folder, name)) or not os.path.exists(folder)


def holder(folder: Path, name: str) -> str:
    """The holder of `name`, for messages."""
    return _signature(folder, name) or "a process that has just started or stopped"


def _signature(folder: Path, name: str) -> str:
    """The text of the file; "" shortly after it was locked, and after it was removed."""
    with contextlib.suppress(OSError):
        return _file(folder, name).read_text(errors="replace")
    return ""


def _pid(signature: str) -> int:
    """The process id in a signature; 0 if it has none."""
    found = _PID.search(signature)
    return int(found[1]) if found else 0


def _file(folder: Path, name: str) -> Path:
    return folder / f"{file_name(name)}.lock"


def file_name(name: str) -> str:
    """The file name for a channel, or for the first part of its name."""
    plain = name.replace("/", ".")  # segments of channels contain no dots
    if len(plain.encode()) > _LONGEST:
        plain = f"{plain[: _LONGEST // 2]}-{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    return plain


def _is(path: Path, held: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(held))
    except FileNotFoundError:
        return False
