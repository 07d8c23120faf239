"""Being told when a folder changes, where the system can tell (Linux: inotify)."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import threading
import time
from pathlib import Path

log = logging.getLogger("robocomp.transport")

_MOVED_TO, _DELETED = 0x80, 0x200
_SELF_GONE = 0x400 | 0x800  # deleted, or moved
_GONE = _SELF_GONE | 0x8000  # ignored: nothing more will be told
_TOO_MUCH = 0x4000

_UNWATCHED = "unwatched"
_WHILE = 60.0
"""Seconds within which one of all processes says that it cannot watch a folder: of hundreds, most cannot."""

ENDING = b".json"
"""Of the files that are told of; others come and go beside them."""


class FolderWatch:
    """A descriptor that has input when files of a folder were put there, by renaming, or went.

    Without `working` nothing is told, since the system cannot, or will not, or the folder has gone: then look from
    time to time, and `renew`.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._lock = os.fsencode(folder), threading.Lock()
        self.working = False
        self.fileno = -1
        self._names: set[str] = set()
        self._knows = False
        """Whether `_names` are all that have changed."""
        with contextlib.suppress(AttributeError):  # another system than Linux
            self._library = ctypes.CDLL(None, use_errno=True)
            self.fileno = self._library.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
            if self.fileno < 0:
                why = os.strerror(ctypes.get_errno())  # each user has 128 of them as a rule, for all processes
                log.log(
                    logging.WARNING if _is_first(folder) else logging.DEBUG,
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
                mask = _MOVED_TO | _DELETED | _SELF_GONE
                self.working = self._library.inotify_add_watch(self.fileno, self._folder, mask) >= 0

    def read(self) -> bool:
        """Take note of what was told; whether that is news."""
        with self._lock:
            return self._read()

    def changed(self) -> set[str] | None:
        """Names, without ending, of those that have changed since this was called last; None if any may have."""
        with self._lock:
            if self.working:
                self._read()
            names, self._names = self._names, set()
            knows, self._knows = self._knows, self.working
            return names if knows and self.working else None

    def forget(self) -> None:
        """What was told could not be looked at: any file may have changed."""
        self._knows = False

    def _read(self) -> bool:
        is_news = False
        with contextlib.suppress(BlockingIOError):
            while self.fileno >= 0:
                told = os.read(self.fileno, 65536)
                at = 0
                while at < len(told):
                    mask = int.from_bytes(told[at + 4 : at + 8], "little")
                    begin, at = at + 16, at + 16 + int.from_bytes(told[at + 12 : at + 16], "little")
                    name = told[begin:at].rstrip(b"\0")
                    if mask & _GONE:
                        self.working = False
                    elif mask & _TOO_MUCH:
                        self._knows = False
                    elif name.endswith(ENDING):
                        self._names.add(os.fsdecode(name[: -len(ENDING)]))
                    else:
                        continue
                    is_news = True
        return is_news

    def close(self) -> None:
        with self._lock:
            self.working = False
            if self.fileno >= 0:
                os.close(self.fileno)
                self.fileno = -1


def _is_first(folder: Path) -> bool:
    """Whether nobody has said for a while that a folder cannot be watched."""
    told = folder / _UNWATCHED
    with contextlib.suppress(OSError):
        if abs(time.time() - told.stat().st_mtime) < _WHILE:
            return False
    with contextlib.suppress(OSError):
        told.touch()
    return True
