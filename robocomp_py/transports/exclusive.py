"""Only one may hold a name on this machine: a locked file per name, in a folder of the user's own.

The kernel lets go of the lock when its process ends, however that happens; the file may stay
behind then, and means nothing.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
from pathlib import Path

from ..errors import TransportError


class Claim:
    """A name that is ours until `close`."""

    def __init__(self, path: Path, held: int) -> None:
        self._path, self._held = path, held

    def close(self) -> None:
        """Let others have it. Idempotent."""
        held, self._held = self._held, -1
        if held >= 0:
            self._path.unlink(missing_ok=True)  # while we hold it, so that nobody else's file is removed
            os.close(held)


def claim(folder: Path, name: str, owner: str) -> Claim:
    """Take a name; raises TransportError, saying who has it, if somebody does."""
    folder.mkdir(mode=0o700, exist_ok=True)
    path = folder / f"{hashlib.sha256(name.encode()).hexdigest()[:32]}.served"
    while True:
        held = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(held, 4096, 0).decode(errors="replace") or "somebody"
            os.close(held)
            raise TransportError(f"{name}: already served by {holder}") from None
        if _is(path, held):
            os.ftruncate(held, 0)
            os.pwrite(held, f"{owner} (pid {os.getpid()})".encode(), 0)
            return Claim(path, held)
        os.close(held)  # its holder removed it between our opening and locking it: there is another one now, or none


def _is(path: Path, held: int) -> bool:
    with contextlib.suppress(FileNotFoundError):
        return os.path.samestat(os.stat(path), os.fstat(held))
    return False
