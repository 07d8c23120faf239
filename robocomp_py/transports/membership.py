"""What this process writes into a directory: its own member, and the entries of its links."""

from __future__ import annotations

import contextlib
import fcntl
import json
import logging
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from ..errors import TransportError
from .members import Entry, told_of
from .places import INDEX, link_into, places_of, remove_all, withdraw_from
from .runtime_folder import as_transport_error

log = logging.getLogger("robocomp.transport")


class Membership:
    """The own member of this process, while it is open."""

    def __init__(self, folder: Path, owner: str) -> None:
        self.id = f"{os.getpid()}-{os.urandom(4).hex()}"
        self._file, self._lock_file = folder / f"{self.id}.json", folder / f"{self.id}.lock"
        self._owner = owner
        self._entries: list[Entry] = []
        self._shown: dict[str, list[Entry]] = {}
        """By place: the entries announced there."""
        self._gathering = 0
        self._unwritten = False
        self._written = 0
        """The time stamp of the file, in ns; no two writes have the same."""
        self._lock = threading.Lock()
        with as_transport_error(folder):
            self._held = os.open(self._lock_file, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(self._held, fcntl.LOCK_EX)
            self._write()
        except BaseException:
            self.close()
            raise

    def address(self, suffix: str) -> Path:
        """A path for a socket; it is removed with the other files of this member."""
        return self._file.with_name(f"{self.id}-{suffix}")

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The announced entries."""
        return tuple(self._entries)

    @contextlib.contextmanager
    def gathered(self) -> Iterator[None]:
        """Entries added in this context are written together at its end, since each write makes every peer look."""
        with self._lock:
            self._gathering += 1
        try:
            yield
        finally:
            with self._lock:
                self._gathering -= 1
                if not self._gathering and self._unwritten and self._held >= 0:
                    self._write()

    def add(self, entry: Entry) -> None:
        """Announce an entry; raises TransportError if that cannot be written."""
        with self._lock:
            self._entries.append(entry)
            try:
                self._write()
            except TransportError:
                self._entries.remove(entry)
                with contextlib.suppress(TransportError):  # some peers may have read the entry already
                    self._write()
                raise

    def remove(self, entry: Entry) -> None:
        """Withdraw an entry. A failure is only logged, since closing has to go on."""
        with self._lock:
            if entry not in self._entries or self._held < 0:
                return
            self._entries.remove(entry)
            try:
                self._write()
            except TransportError as exc:
                if self._file.exists():
                    log.warning("%s is still announced: %s", entry.channel, exc)

    def close(self) -> None:
        with self._lock:
            if self._held < 0:
                return
            held, self._held = self._held, -1
            with contextlib.suppress(OSError):  # the next member that looks removes it
                # first, so that peers that see the entries go find no living process
                self._lock_file.unlink(missing_ok=True)
            os.close(held)  # which may be the last descriptor, and folders cannot be read without one
            with contextlib.suppress(OSError):
                remove_all(self._file.parent, self.id, self._shown)

    def _write(self) -> None:
        self._unwritten = bool(self._gathering)
        if self._gathering:
            return
        record = {"owner": self._owner, "pid": os.getpid(), "entries": list(map(told_of, self._entries))}
        draft = self._file.with_suffix(".draft")
        with as_transport_error(self._file.parent):
            self._lock_file.stat()  # without the lock file, peers take this process for dead
            draft.write_text(json.dumps(record))
            self._written = max(self._written + 1, time.time_ns())
            os.utime(draft, ns=(self._written, self._written))  # see `_stamp`
            draft.replace(self._file)
            self._show()

    def _show(self) -> None:
        """Update the links in the places of our entries, so that members that look there see the change."""
        shown: dict[str, list[Entry]] = {}
        for entry in self._entries:
            places = places_of(entry.channel)
            shown[places.own] = shown.setdefault(places.all, [])  # the same entries in every place of a member
            shown[places.all].append(entry)
        index = os.path.join(self._file.parent, INDEX)
        for place in self._shown.keys() - shown.keys():
            withdraw_from(os.path.join(index, place), self.id)
            del self._shown[place]
        for place, entries in shown.items():
            if place not in self._shown:
                link_into(os.path.join(index, place), self.id)
            elif entries != self._shown[place]:
                with contextlib.suppress(FileNotFoundError):  # the folder was removed
                    os.utime(os.path.join(index, place))
            self._shown[place] = entries  # only now, so that a failed update is repeated
