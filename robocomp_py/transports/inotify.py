"""Being told when a folder changes, where the system can tell (Linux: inotify)."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import threading
from pathlib import Path

log = logging.getLogger("robocomp.transport")

_MOVED_TO, _CREATED, _DELETED = 0x80, 0x100, 0x200
_SELF_GONE = 0x400 | 0x800  # deleted, or moved
_GONE = _SELF_GONE | 0x8000  # ignored: nothing more will be told


class FolderWatch:
    """A descriptor that has input when files of a folder came, went or were replaced.

    Without `working` nothing is told, since the system cannot, or will not, or the folder has gone: then look from
    time to time, and `renew`.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._lock = os.fsencode(folder), threading.Lock()
        self.working = False
        self.fileno = -1
        with contextlib.suppress(AttributeError):  # another system than Linux
            self._library = ctypes.CDLL(None, use_errno=True)
            self.fileno = self._library.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
            if self.fileno < 0:
                why = os.strerror(ctypes.get_errno())  # each user has 128 of them as a rule, for all processes
                log.warning(
                    "%s is looked at from time to time instead of being watched: %s; "
                    "allow for more (sysctl fs.inotify.max_user_instances)",
                    folder,
                    why,
                )
            self.renew()

    def renew(self) -> None:
        """Begin, if it is not working."""
        with self._lock:
            if self.fileno >= 0 and not self.working:
                mask = _MOVED_TO | _CREATED | _DELETED | _SELF_GONE
                self.working = self._library.inotify_add_watch(self.fileno, self._folder, mask) >= 0

    def read(self) -> bool:
        """Take note of what was told; whether anything was."""
        told = b""
        with self._lock, contextlib.suppress(BlockingIOError):
            while self.fileno >= 0:
                told = os.read(self.fileno, 65536)
                at = 0
                while at < len(told):
                    mask = int.from_bytes(told[at + 4 : at + 8], "little")
                    at += 16 + int.from_bytes(told[at + 12 : at + 16], "little")
                    if mask & _GONE:
                        self.working = False
        return bool(told)

    def close(self) -> None:
        with self._lock:
            self.working = False
            if self.fileno >= 0:
                os.close(self.fileno)
                self.fileno = -1
