"""Who waits is woken by a bell: one waits, many ring, and the number that is rung says what for.

A bell is a named pipe in the run-time folder, beside the files of its transport's member, and goes with them. What is
written to it are the numbers, an octet each, so one read takes all that was rung since the last one; and only the
first of them wakes anybody.
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

BELLS = 64
"""Different ways in which one bell can be rung."""

MAIL = 0
"""There is something in the queue that belongs to the bell."""

LOOK = BELLS - 1
"""Something became due, or is to be seen in the directory."""

NEWS = BELLS - 2
"""The folder that is watched has changed."""


SOON = BELLS - 3
"""Something is about to be written. All it does is to wake: who does not find it yet waits on."""


def bell_of(number: int) -> int:
    """What is rung for the link of that number. Several may share one."""
    return 1 + number % (BELLS - 4)


SLICE = 0.05
"""Seconds after which somebody who waits for one thing looks whether there is still a point in it."""

_SLICE_MS = int(SLICE * 1000)

_NUMBERS = [bytes((number,)) for number in range(BELLS)]

_ROOM = 4096
"""Numbers that may wait. If there are so many, there may have been more, and all count as rung."""


def bell_path(folder: Path, member_id: str, line: int = 0) -> Path:
    """The bell of a transport, or of a line of it. By its name the directory finds it, and removes it with the dead."""
    return folder / f"{member_id}.{line}.bell"


class Bell:
    """Ours."""

    def __init__(self, path: Path, watch: Watch | None = None) -> None:
        """With a `watch`, of which `NEWS` are rung."""
        self._path, self._watch = path, watch
        try:
            os.mkfifo(path, 0o600)
            self._end = _end(path, os.O_RDWR)  # so that there is always somebody to write, and it never ends
            fcntl.fcntl(self._end.fileno, fcntl.F_SETPIPE_SZ, _ROOM)
        except OSError as exc:
            raise _error(path, exc) from exc
        poll = select.poll()
        poll.register(self._end.fileno, select.POLLIN)
        if watch and watch.fileno >= 0:
            poll.register(watch.fileno, select.POLLIN)
        self._poll = poll.poll

    def wait(self, seconds: float) -> Iterable[int]:
        """Wait until it rings, at most so long; what was rung since the last time, which may be nothing.

        One number in bytes if it rang once, apart from `SOON`; else something to be looked through.
        """
        found = self._poll(seconds * 1000)
        if not found:
            return ()
        if self._watch and (len(found) > 1 or found[0][0] == self._watch.fileno):
            self._watch.read()
            return (NEWS, *self._read())
        return self._read()

    def rung(self, seconds: float) -> bool:
        """Wait likewise, but not longer than a slice; whether it rang."""
        if not self._poll(_SLICE_MS if seconds >= SLICE else max(0.0, seconds * 1000)):
            return False
        self._read()
        return True

    def _read(self) -> Iterable[int]:
        end = self._end  # which stays open as long as we have it
        try:
            rung = os.read(end.fileno, _ROOM)
        except OSError:  # nothing; or it was closed meanwhile
            return ()
        if len(rung) >= _ROOM:
            return range(BELLS)
        if rung[0] == SOON:
            rung = rung.lstrip(_NUMBERS[SOON])
        return rung if len(rung) < 2 else set(rung)

    def close(self) -> None:
        self._poll, self._end = _silence, _NOWHERE
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)


class Rope:
    """By which another's bell is rung, from any thread."""

    def __init__(self, path: Path) -> None:
        try:
            self._end = _end(path, os.O_WRONLY)
        except OSError as exc:
            raise _error(path, exc) from exc

    def ring(self, number: int) -> bool:
        """Whether there is somebody to hear it."""
        end = self._end  # which stays open as long as we have it
        try:
            os.write(end.fileno, _NUMBERS[number])
        except BlockingIOError:  # so much was rung that it counts as rung, too
            return True
        except OSError:
            return False
        return True

    def close(self) -> None:
        self._end = _NOWHERE


class _End:
    """A descriptor that is closed once nobody has it: never while a thread is about to write to what it stands for."""

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
