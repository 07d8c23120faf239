"""How far each reader of reliable topics has come, where the publishers see it: in a file that both have mapped.

A subscriber has a file; each publisher that it hears has a slot in it:

    source u64 · taken u64, the number of the last message that was read · call u64, wake the sender when that is read

So a publisher knows without messages how far it is ahead of each subscriber; it is woken only if it waits.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from ...errors import TransportError

SLOTS = 1024
"""Maximum number of publishers of a reliable subscriber."""

OPENED = 0
"""The number of the file with the count of opened messages by sender; no link has this number."""

_SLOT = struct.Struct("<QQQ")
_NUMBER = struct.Struct("<Q")
_TAKEN, _CALL = 8, 16
_SIZE = SLOTS * _SLOT.size

_LONGEST_PAUSE = 0.001

_SLICE = 0.02
"""Seconds after which a waiting publisher looks at the receipts, in case a wake-up is lost."""


class Receipts:
    """A subscriber's own file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._slots: dict[int, int] = {}
        self._free = list(range(SLOTS))[::-1]
        with _mapping(path, os.O_CREAT | os.O_EXCL | os.O_RDWR) as descriptor:
            try:
                os.posix_fallocate(descriptor, 0, _SIZE)  # else, on a full disk, the first write kills the process
                self._map = mmap.mmap(descriptor, _SIZE)
            except BaseException:
                self.close()
                raise

    def begin(self, source: int) -> None:
        """Reserve a slot for a publisher, before its messages are read. Raises TransportError if all are taken."""
        if not self._free:
            raise TransportError(f"shm: more than {SLOTS} publishers of one reliable topic")
        self._slots[source] = free = self._free.pop()
        _SLOT.pack_into(self._map, free * _SLOT.size, source, 0, 0)

    def took(self, source: int, sequence: int) -> bool:
        """Note a message; whether its publisher has to be woken, which one that has left has not."""
        slot = self._slots.get(source)
        if slot is None:
            return False
        at = slot * _SLOT.size
        _NUMBER.pack_into(self._map, at + _TAKEN, sequence)
        (call,) = _NUMBER.unpack_from(self._map, at + _CALL)
        if not 0 < call <= sequence:
            return False
        _NUMBER.pack_into(self._map, at + _CALL, 0)
        return True

    def end(self, source: int) -> None:
        slot = self._slots.pop(source, None)
        if slot is not None:
            _SLOT.pack_into(self._map, slot * _SLOT.size, 0, 0, 0)
            self._free.append(slot)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)


class Reader:
    """One reader, as its publisher sees it. Its receipts are valid once it has begun to read."""

    def __init__(self, path: Path, source: int, sent: int) -> None:
        self._path, self._source, self._met = path, source, sent
        self._map: mmap.mmap | None = None
        self._at = 0

    def taken(self) -> int:
        """The number of the last message that it took or does not need."""
        if self._map is None and not self._find():
            return self._met
        assert self._map
        source, taken, _ = _SLOT.unpack_from(self._map, self._at)
        return max(taken, self._met) if source == self._source else self._met

    def call_at(self, number: int) -> None:
        """Have the reader wake us when it has taken that message."""
        if self._map is not None:
            _NUMBER.pack_into(self._map, self._at + _CALL, number)

    def _find(self) -> bool:
        with contextlib.suppress(TransportError), _mapping(self._path, os.O_RDWR) as descriptor:
            if os.fstat(descriptor).st_size < _SIZE:
                return False  # it is just being created
            found = mmap.mmap(descriptor, _SIZE)
            for at in range(0, _SIZE, _SLOT.size):
                if _NUMBER.unpack_from(found, at)[0] == self._source:
                    self._map, self._at = found, at
                    return True
        return False


class Backlog:
    """How far a publisher may go ahead of its slowest reader."""

    def __init__(self) -> None:
        self._called = threading.Event()
        self._lock = threading.Lock()
        self._readers: list[Reader] = []
        self.slowest = sys.maxsize
        """The last message that all readers had taken at the last look."""

    def meet(self, readers: list[Reader]) -> None:
        """These are the readers from now on."""
        with self._lock:
            self._readers = readers
        self._slowest()

    def wait(self, sent: int, ahead: int, end: float, still: Callable[[], object]) -> bool:
        """Wait until a message may be sent, at most `ahead` beyond the slowest reader. `still` may raise."""
        while sent - self._slowest() >= ahead:
            self._called.clear()
            for reader in self._readers:
                reader.call_at(max(1, sent - ahead // 2))  # half-way, to wake the publisher less often
            left = end - time.monotonic()
            if sent - self._slowest() < ahead:  # meanwhile, and so perhaps without a wake-up
                break
            if left <= 0:
                return False
            self._called.wait(min(left, _SLICE))
            still()
        return True

    def settle(self, sent: int, end: float) -> None:
        """Wait until all messages were taken, at most until `end`."""
        while self._slowest() < sent and (left := end - time.monotonic()) > 0:
            time.sleep(min(left, _LONGEST_PAUSE))

    def called(self) -> None:
        """A reader has woken us."""
        self._called.set()

    def _slowest(self) -> int:
        with self._lock:  # else a thread that waits could overwrite the result of `meet` with that of earlier readers
            self.slowest = slowest = min((reader.taken() for reader in self._readers), default=sys.maxsize)
        return slowest


@contextlib.contextmanager
def _mapping(path: Path, flags: int) -> Iterator[int]:
    try:
        descriptor = os.open(path, flags | os.O_CLOEXEC, 0o600)
        try:
            yield descriptor
        finally:
            os.close(descriptor)
    except OSError as exc:
        raise TransportError(f"shm: {path}: {exc.strerror}") from exc
