"""What only one on this host may have: a channel that is served, a router that is run.

A claim is a locked file in the run-time folder. The kernel releases it when its process ends,
however that happens; the file says who holds it, for messages to people.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import threading
from pathlib import Path

from ..errors import AlreadyServed

_LONGEST = 200
"""File names may have 255 bytes; longer ones are shortened to so many, with a digest of the whole."""


class Claim:
    """Held until it is closed, or its process has ended."""

    def __init__(self, path: Path, held: int) -> None:
        self._path, self._held = path, held
        self._lock = threading.Lock()

    def close(self) -> None:
        with self._lock:
            if self._held >= 0:
                self._path.unlink(missing_ok=True)  # while it is locked: nobody else can have claimed it meanwhile
                os.close(self._held)
                self._held = -1


def claim(folder: Path, name: str, owner: str) -> Claim:
    """Have `name` to ourselves. Raises AlreadyServed, naming who has it, if somebody does."""
    claimed = try_claim(folder, name, owner)
    if claimed is None:
        raise AlreadyServed(f"{name}: already served by {holder(folder, name)}")
    return claimed


def try_claim(folder: Path, name: str, owner: str) -> Claim | None:
    """Have `name` to ourselves, or None if somebody else has it. Never waits."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = _file(folder, name)
    while True:
        held = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(held)
            return None
        if _is(path, held):
            os.ftruncate(held, 0)
            os.write(held, f"{owner or 'somebody'} (pid {os.getpid()})".encode())
            return Claim(path, held)
        os.close(held)  # who had it removed the file between our two steps


def holder(folder: Path, name: str) -> str:
    """Who has claimed `name`, in words."""
    with contextlib.suppress(OSError):
        return _file(folder, name).read_text(errors="replace") or "somebody who just began"
    return "somebody who just left"


def _file(folder: Path, name: str) -> Path:
    plain = name.replace("/", ".")  # segments of channels contain no dots
    if len(plain.encode()) > _LONGEST:
        plain = f"{plain[: _LONGEST // 2]}-{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    return folder / f"{plain}.lock"


def _is(path: Path, held: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(held))
    except FileNotFoundError:
        return False
