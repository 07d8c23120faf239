"""Memory for large messages. Those that fit into a slot of iceoryx2's do not need any of it.

Each transport has a heap: a file in shared memory, from which its messages take whole pages. What passes through
iceoryx2 then says where the payload lies. These pages are in use as long as the slot that tells of them, which
iceoryx2 knows even of readers that were killed. The sender learns that a slot is free when iceoryx2 gives it that
slot again. Where this takes too long, it asks for all of its free slots, and returns them.

A heap keeps at most one and a half times the memory that is in use, and `SPARE`. If nothing large is sent for a
while, all but `SPARE` goes back to the system.
"""

from __future__ import annotations

import contextlib
import fcntl
import mmap
import os
import threading
import time
from pathlib import Path
from typing import Protocol

import numpy as np

from ...errors import TransportError
from ..border import translating
from .pages import Pages
from .room import PAGE, SHARED_MEMORY, Full, own, what_is_short

SPARE = 2 * 1024 * 1024 // PAGE
"""Pages that may have memory besides one and a half times those that are in use."""

_BEGIN = 64 * 1024 * 1024 // PAGE
"""Pages that a new heap has addresses for; it has more when these do not suffice. Addresses are not memory yet."""

LINGERING = 5.0
"""Seconds for which a heap is kept after its owner has left: an answer may be on its way to a thread."""

_SUFFIX = ".heap"

_as_transport_error = translating("shm", OSError, lambda exc: f"{exc.strerror}{what_is_short()}")


class Borrower(Protocol):
    """A port, which binds pages to its slots."""

    def find_free(self) -> None:
        """Give back the pages of all slots that are free. Called with the heap's lock."""

    def end(self) -> None:
        """Let go of all slots: the heap is closed."""


class Heap:
    """The heap of this transport. Safe to use from any thread."""

    def __init__(self, prefix: str, number: int) -> None:
        """The number is unique among all heaps of that prefix."""
        self.number = number
        self.lock = threading.RLock()
        self.borrowers: set[Borrower] = set()
        """Those that may have pages."""
        self._in_use = 0
        """Pages known to have been in use at once, a short while ago."""
        self._path = _path(prefix, number)
        self._pages = Pages(_BEGIN)
        new = self._path.with_suffix(".new")
        with _as_transport_error(self._path), contextlib.ExitStack() as undo:
            self._file = os.open(new, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_CLOEXEC, 0o600)
            undo.callback(os.close, self._file)
            undo.callback(new.unlink, missing_ok=True)
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # until we end: see `remove_dead`
            self._map()
            new.rename(self._path)
            undo.pop_all()

    def take(self, count: int) -> int:
        """The first of a number of pages, with memory. Raises `Full` if there is not enough."""
        with self.lock:
            if self._file < 0:
                raise TransportError("shm: the transport is closed")
            pages = self._pages
            self._in_use = max(self._in_use, count)
            begin = self._place(count)
            cold = pages.cold(begin, count)
            if cold and pages.warm + cold > self._limit():
                self._find_free()
                self._in_use = max(count, pages.taken + count)
                begin = self._place(count)
            if cold := pages.take(begin, count):
                self._give_back(self._limit())
                try:
                    self._own(begin, count, cold)
                except Full:
                    pages.give(begin, count)
                    self._give_back(0)
                    raise
            return begin

    def give(self, begin: int, count: int) -> None:
        """Take back pages that are no longer used."""
        with self.lock:
            self._pages.give(begin, count)

    def tidy(self) -> None:
        """Give memory that is free back to the system. To be called about once a second."""
        if not self._pages.taken and self._pages.warm <= SPARE:
            return
        with self.lock:
            if self._file < 0:
                return
            self._find_free()
            self._in_use = max(self._in_use, self._pages.taken)
            self._give_back(self._limit())
            self._in_use = self._pages.taken

    def memory(self, offset: int, size: int) -> memoryview:
        """These bytes. They can be used even after the heap is closed."""
        found = self._memory[offset : offset + size]
        if len(found) < size:
            raise TransportError("shm: the transport is closed")
        return found

    def close(self) -> None:
        """Close the heap. Idempotent. Readers keep what they have."""
        with self.lock:
            if self._file < 0:
                return
            self._find_free()
            self._give_back(0)
            self._memory = memoryview(b"")
            del self._whole
            with contextlib.suppress(OSError):
                self._path.unlink(missing_ok=True)
            os.close(self._file)
            self._file = -1
            for borrower in tuple(self.borrowers):
                borrower.end()
            self.borrowers.clear()

    # With the lock.

    def _limit(self) -> int:
        return self._in_use * 3 // 2 + SPARE

    def _place(self, count: int) -> int:
        begin = self._pages.place(count)
        if begin is None:
            self._pages.grow(2 * self._pages.size + count)
            with _as_transport_error(self._path):
                self._map()
            begin = self._pages.place(count)
            assert begin is not None
        return begin

    def _map(self) -> None:
        size = self._pages.size * PAGE
        os.ftruncate(self._file, size)
        self._whole = mmap.mmap(self._file, size)
        self._memory = memoryview(self._whole)
        self._address = np.frombuffer(self._whole, np.uint8).ctypes.data

    def _own(self, begin: int, count: int, cold: int) -> None:
        """Have memory for these pages."""
        address = self._address + begin * PAGE
        try:
            own(address, count * PAGE, cold * PAGE)
        except Full:
            self._find_free()
            self._give_back(0)
            own(address, count * PAGE, cold * PAGE)

    def _find_free(self) -> None:
        for borrower in tuple(self.borrowers):
            borrower.find_free()

    def _give_back(self, keep: int) -> None:
        for begin, count in self._pages.chill(keep):
            self._whole.madvise(mmap.MADV_REMOVE, begin * PAGE, count * PAGE)


class Heaps:
    """The heaps of other transports that are read. Safe to use from any thread."""

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._found: dict[int, Mapped] = {}

    def meet(self, number: int) -> None:
        """Map that heap, so that it can be read even after its owner has left. Does nothing if the owner has left."""
        with contextlib.suppress(TransportError):
            self.of(number)

    def of(self, number: int) -> Mapped:
        """That heap, mapped. Raises TransportError if it is not there any more."""
        found = self._found.get(number)
        if found is None:
            found = self._found.setdefault(number, Mapped(_path(self._prefix, number)))
        return found

    def forget_left(self) -> None:
        """Unmap heaps whose owners left `LINGERING` seconds ago; readers keep the messages that they still use."""
        for number, found in list(self._found.items()):
            if found.is_left():
                self._found.pop(number, None)

    def known(self) -> set[int]:
        """The numbers of the heaps that are mapped."""
        return set(self._found)

    def close(self) -> None:
        self._found.clear()


class ReadOnly(mmap.mmap):
    """Memory that only its sender writes to."""

    frozen = True  # see `wire.arrays.is_frozen`


class Mapped:
    """The heap of another transport, for reading."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file, self._left = -1, 0.0
        with _as_transport_error(path):
            self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            self._map()

    def at(self, offset: int, size: int) -> ReadOnly:
        """Memory that has these bytes there. Raises ValueError if there are none."""
        if offset + size > self._size:
            with _as_transport_error(self._path):
                self._map()  # it has grown
            if offset + size > self._size:
                raise ValueError(f"{offset} + {size} of {self._size} bytes")
        return self._memory

    def is_left(self) -> bool:
        """Whether the owner was first seen to have left `LINGERING` seconds ago: what it sent has been read by then."""
        if os.fstat(self._file).st_nlink:
            return False
        self._left = self._left or time.monotonic()
        return time.monotonic() >= self._left + LINGERING

    def _map(self) -> None:
        size = os.fstat(self._file).st_size
        self._memory = ReadOnly(self._file, size, prot=mmap.PROT_READ)
        self._size = size

    def __del__(self) -> None:
        if self._file >= 0:
            os.close(self._file)


def remove_dead(prefix: str) -> None:
    """Remove heaps of processes that were killed, as their locks show."""
    try:
        heaps = list(Path(SHARED_MEMORY).glob(f"{prefix}*{_SUFFIX}"))
    except OSError:  # no descriptor is left: the next node removes them
        return
    for path in heaps:
        with contextlib.suppress(OSError):  # it has gone, or is in use or another user's
            file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink()
            finally:
                os.close(file)


def _path(prefix: str, number: int) -> Path:
    return Path(SHARED_MEMORY, f"{prefix}{number:016x}{_SUFFIX}")
