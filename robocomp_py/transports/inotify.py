"""Watches folders for changes, where the system can report them (Linux: inotify)."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import threading
import time
from pathlib import Path

from .unsafe import add_watch, watch

log = logging.getLogger("robocomp.transport")

_TOUCHED, _MOVED_TO, _CREATED, _DELETED = 0x4, 0x80, 0x100, 0x200
_GONE = 0x8000
"""No more changes of a folder will be reported."""
_TOO_MUCH = 0x4000

UNWATCHED = "unwatched"
"""The file that marks a folder as one that cannot be watched."""
_WHILE = 60.0
"""Seconds within which only one process logs that it cannot watch a folder, since hundreds may be affected."""


class Watch:
    """A descriptor that has input when a file was added to or removed from a watched folder, or the folder was touched.

    If the system cannot watch, nothing is reported, and the caller has to look from time to time.
    """

    def __init__(self, folder: Path) -> None:
        """`folder` is named in the log if nothing can be watched."""
        self._lock = threading.Lock()
        self.fileno = -1
        self._watched: set[str] = set()
        self._folders: dict[int, str] = {}
        self._changed: set[str] = set()
        try:
            self.fileno = watch()
        except OSError as exc:
            if exc.errno != errno.ENOSYS:  # another system than Linux
                log.log(
                    logging.WARNING if _is_first(folder) else logging.DEBUG,
                    "%s is looked at from time to time instead of being watched: %s; "
                    "allow for more (sysctl fs.inotify.max_user_instances)",
                    folder,
                    exc.strerror,  # usually, all processes of a user share 128 instances
                )

    @property
    def able(self) -> bool:
        """Whether anything can be watched."""
        return self.fileno >= 0

    def add(self, folder: str) -> None:
        """Watch a folder, if it exists and can be watched."""
        mask = _TOUCHED | _MOVED_TO | _CREATED | _DELETED
        with self._lock:
            if self.fileno >= 0:
                with contextlib.suppress(OSError):
                    self._folders[add_watch(self.fileno, folder, mask)] = folder
                    self._watched.add(folder)

    def watches(self, folder: str) -> bool:
        return folder in self._watched

    def read(self) -> bool:
        """Read the input; whether there are unread changes."""
        with self._lock:
            self._read()
            return bool(self._changed)

    def changed(self) -> set[str]:
        """The folders that have changed since this was called last, also those that are not watched any more."""
        with self._lock:
            self._read()
            changed, self._changed = self._changed, set()
            return changed

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while self.fileno >= 0:
                told = os.read(self.fileno, 65536)
                at = 0
                while at < len(told):
                    number = int.from_bytes(told[at : at + 4], "little", signed=True)
                    mask = int.from_bytes(told[at + 4 : at + 8], "little")
                    at += 16 + int.from_bytes(told[at + 12 : at + 16], "little")
                    if mask & _TOO_MUCH:
                        self._changed |= self._watched
                        self._watched.clear()  # the removal of a folder may have been missed, too
                    elif number in self._folders:
                        folder = self._folders[number]
                        self._changed.add(folder)
                        if mask & _GONE:
                            del self._folders[number]
                            self._watched.discard(folder)

    def close(self) -> None:
        with self._lock:
            self._watched.clear()
            if self.fileno >= 0:
                os.close(self.fileno)
                self.fileno = -1


def _is_first(folder: Path) -> bool:
    """Whether no process has logged lately that this folder cannot be watched."""
    told = folder / UNWATCHED
    with contextlib.suppress(OSError):
        if abs(time.time() - told.stat().st_mtime) < _WHILE:
            return False
    with contextlib.suppress(OSError):
        told.touch()
    return True
