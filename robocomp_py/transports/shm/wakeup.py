"""Wake-ups: one thread waits, many threads and processes wake it, each with a number that says why.

A wake-up is a named pipe in the run-time folder, beside the files of its transport's member, and is removed with
them. Each wake-up writes its number as one octet. One read takes all numbers since the last read, and only the first
of them wakes the thread.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
from collections.abc import Iterable
from pathlib import Path

from ...errors import TransportError
from ..inotify import Watch
from .room import what_is_short

WAKEUPS = 64
"""Different numbers that one pipe can receive."""

QUEUED = 0
"""The queue of this pipe has messages."""

LOOK = WAKEUPS - 1
"""A timer has expired, or the directory has changed."""

NEWS = WAKEUPS - 2
"""The watched folder has changed."""

NUDGE = WAKEUPS - 3
"""A message is about to be written. The woken thread waits on if the message is not there yet."""


def wakeup_of(number: int) -> int:
    """The wake-up number of a link. Several links may share one."""
    return 1 + number % (WAKEUPS - 4)


SLICE = 0.05
"""Seconds after which a waiting thread checks whether the wait still makes sense."""

_SLICE_MS = int(SLICE * 1000)

_NUMBERS = [bytes((number,)) for number in range(WAKEUPS)]

_ROOM = 4096
"""Numbers that the pipe holds. If it is full, some may be missing, and all numbers count as received."""


def wakeup_path(folder: Path, member_id: str, line: int = 0) -> Path:
    """The pipe of a transport or of one of its lines. By its name the directory finds it when its process has died."""
    return folder / f"{member_id}.{line}.bell"


class Wakeup:
    """The reading end of our own pipe."""

    def __init__(self, path: Path, watch: Watch | None = None) -> None:
        """With a `watch`, changes in its folder are reported as `NEWS`."""
        self._path, self._watch = path, watch
        try:
            os.mkfifo(path, 0o600)
            self._end = _end(path, os.O_RDWR)  # with a writer of our own, the pipe never reports its end
            fcntl.fcntl(self._end.fileno, fcntl.F_SETPIPE_SZ, _ROOM)
        except OSError as exc:
            raise _error(path, exc) from exc
        poll = select.poll()
        poll.register(self._end.fileno, select.POLLIN)
        if watch and watch.fileno >= 0:
            poll.register(watch.fileno, select.POLLIN)
        self._poll = poll.poll

    def wait(self, seconds: float) -> Iterable[int]:
        """Wait at most that long; the numbers received since the last time, which may be none.

        A single number, apart from `NUDGE`, comes as bytes of length one; several come as some other iterable.
        """
        found = self._poll(seconds * 1000)
        if not found:
            return ()
        if self._watch and (len(found) > 1 or found[0][0] == self._watch.fileno):
            self._watch.read()
            return (NEWS, *self._read())
        return self._read()

    def woken(self, seconds: float) -> bool:
        """Wait likewise, but not longer than `SLICE`; whether a number came."""
        if not self._poll(_SLICE_MS if seconds >= SLICE else max(0.0, seconds * 1000)):
            return False
        self._read()
        return True

    def _read(self) -> Iterable[int]:
        end = self._end  # this reference keeps it open
        try:
            numbers = os.read(end.fileno, _ROOM)
        except OSError:  # empty, or closed meanwhile
            return ()
        if len(numbers) >= _ROOM:
            return range(WAKEUPS)
        if numbers[0] == NUDGE:
            numbers = numbers.lstrip(_NUMBERS[NUDGE])
        return numbers if len(numbers) < 2 else set(numbers)

    def close(self) -> None:
        self._poll, self._end = _silence, _NOWHERE
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)


class Waker:
    """The writing end of a pipe: wakes its reader, from any thread."""

    def __init__(self, path: Path) -> None:
        try:
            self._end = _end(path, os.O_WRONLY)
        except OSError as exc:
            raise _error(path, exc) from exc

    def wake(self, number: int) -> bool:
        """Send a number; whether the pipe still has a reader."""
        end = self._end  # this reference keeps it open
        try:
            os.write(end.fileno, _NUMBERS[number])
        except BlockingIOError:  # the pipe is full: its reader counts this number as received, too
            return True
        except OSError:
            return False
        return True

    def close(self) -> None:
        self._end = _NOWHERE


class _End:
    """A descriptor that is closed with its last reference, so never while a thread is about to write to it."""

    def __init__(self, fileno: int) -> None:
        self.fileno = fileno

    def __del__(self) -> None:
        if self.fileno >= 0:
            os.close(self.fileno)


_NOWHERE = _End(-1)


def _end(path: Path, how: int) -> _End:
    return _End(os.open(path, how | os.O_NONBLOCK | os.O_CLOEXEC))


def _silence(milliseconds: float | None = None, /) -> list[tuple[int, int]]:
    return []


def _error(path: Path, exc: OSError) -> TransportError:
    return TransportError(f"shm: {path}: {exc.strerror}{what_is_short()}")
