"""The output of a network's processes in files: one for each, rotated when it is long.

    logs/laser.log  laser.log.1  laser.log.2        the newest first
    2026-03-01T12:00:00.123456+00:00 WARNING: too close      as text
    {"time": "…", "name": "laser", "level": "warning", "text": "too close"}    as JSON, a line each

A full disk does not stop the network. It is reported once, lost lines are counted, and their number is written when
there is room again.
"""

from __future__ import annotations

import contextlib
import errno
import json
import logging
import os
import re
import time
from collections.abc import Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

from ..errors import DeploymentError
from .harmless import plain
from .place import file_name
from .ring import Line

log = logging.getLogger("robocomp.deploy")

KEPT = 2
"""Files of each that are kept beside the newest."""

_ALTOGETHER = 256 << 20
"""Approximate bytes of all files of a network; each has its share."""

_SMALLEST, _LARGEST = 64 << 10, 8 << 20
"""Bytes of a file."""

_LEVEL = re.compile(r"(DEBUG|INFO|WARNING|ERROR|CRITICAL): ")


class Form(StrEnum):
    TEXT = "text"
    JSON = "json"


@dataclass
class _File:
    path: Path
    descriptor: int = -1
    size: int = 0
    lost: int = 0
    """Lines since the last one that could be written."""


class Logs:
    """Not thread-safe. Its methods never raise: a failing log must not stop the network."""

    def __init__(
        self,
        folder: Path,
        number: int = 1,
        form: Form = Form.TEXT,
        altogether: int = _ALTOGETHER,
    ) -> None:
        """`number` is how many processes there are, about. Raises DeploymentError if there can be no such folder."""
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as exc:
            raise DeploymentError(f"logs in {folder}: {exc.strerror}") from exc
        self.folder = folder
        self.began = time.time()
        self._form = form
        self._limit = min(_LARGEST, max(_SMALLEST, altogether // (max(1, number) * (KEPT + 1))))
        self._files: dict[str, _File] = {}
        self._told = False
        """Whether it was reported that lines are lost."""

    def write(self, line: Line) -> None:
        """Keep a line of a process."""
        file = self._files.get(line.name)
        if file is None:
            file = self._files[line.name] = _File(self.folder / f"{file_name(line.name)}.log")
        try:
            if file.descriptor < 0:
                self._open(file)
            if file.lost:
                told = f"WARNING: {file.lost} lines were lost here: they could not be written"
                self._append(file, self._written(line._replace(text=told)))
                file.lost = 0
            self._append(file, self._written(line))
            if file.size >= self._limit:
                self._turn_over(file)
        except OSError as exc:
            file.lost += 1
            if not self._told:
                self._told = True
                log.warning("lines are missing in the logs in %s from here on: %s", self.folder, exc.strerror)

    @property
    def lost(self) -> dict[str, int]:
        """Number of lines that could not be written so far."""
        return {name: file.lost for name, file in self._files.items() if file.lost}

    def close(self) -> None:
        """May be called twice."""
        for file in self._files.values():
            if file.descriptor >= 0:
                os.close(file.descriptor)
        self._files.clear()

    def _written(self, line: Line) -> bytes:
        at, name, text = line
        text = plain(text)
        when = datetime.fromtimestamp(at, UTC).isoformat(timespec="microseconds")
        if self._form is Form.TEXT:
            return f"{when} {text}\n".encode(errors="replace")
        found = _LEVEL.match(text)
        level = found[1].lower() if found else ""
        told = {"time": when, "name": name, "level": level, "text": text[found.end() :] if found else text}
        return json.dumps(told).encode() + b"\n"

    def _open(self, file: _File) -> None:
        flags = os.O_CREAT | os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC | os.O_NOFOLLOW
        file.descriptor = os.open(file.path, flags, 0o600)
        file.size = os.fstat(file.descriptor).st_size

    def _append(self, file: _File, line: bytes) -> None:
        """Write a line, or nothing."""
        written = os.write(file.descriptor, line)
        if written < len(line):  # the disk is full now
            os.ftruncate(file.descriptor, file.size)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        file.size += written

    def _turn_over(self, file: _File) -> None:
        os.close(file.descriptor)
        file.descriptor = -1
        for number in range(KEPT, 0, -1):
            older = file.path if number == 1 else _numbered(file.path, number - 1)
            with contextlib.suppress(FileNotFoundError):
                older.replace(_numbered(file.path, number))


def past_lines(folder: Path, names: Collection[str], count: int, since: float = 0.0) -> list[Line]:
    """The newest lines in the files of these processes (of all, if none is named), in the order in which they came.

    Lines from before `since`, which belong to an earlier run, are left out.
    """
    found = [_read(name, text) for name in logged_names(folder, names) for text in _tail(folder / f"{name}.log", count)]
    found = [line for line in found if line.at >= since]
    found.sort(key=lambda line: line.at)
    return found[-count:] if count else []


def logged_names(folder: Path, names: Collection[str] = ()) -> list[str]:
    """The names of log files that belong to these processes and systems (to any, if none is named)."""
    chosen = {file_name(name) for name in names}
    there = sorted(path.stem for path in folder.glob("*.log"))
    return [stem for stem in there if not chosen or any(f"{stem}.".startswith(f"{name}.") for name in chosen)]


def _read(name: str, written: str) -> Line:
    """A line of a file. A line of another program has no time and counts as the oldest."""
    if written.startswith("{"):
        with contextlib.suppress(ValueError, KeyError, TypeError):
            told = json.loads(written)
            text = (f"{told['level'].upper()}: " if told["level"] else "") + str(told["text"])
            return Line(_seconds(str(told["time"])), name, text)
    when, _, text = written.partition(" ")
    with contextlib.suppress(ValueError):
        return Line(_seconds(when), name, text)
    return Line(0.0, name, written)


def _seconds(when: str) -> float:
    return datetime.fromisoformat(when).timestamp()


def _tail(path: Path, count: int) -> list[str]:
    """The last lines of a file, and of those before it as far as it takes."""
    lines: list[str] = []
    for file in (path, *(_numbered(path, number) for number in range(1, KEPT + 1))):
        if len(lines) >= count:
            break
        with contextlib.suppress(OSError):
            lines = [*file.read_bytes().decode(errors="replace").split("\n")[:-1], *lines]
    return lines[-count:]


def _numbered(path: Path, number: int) -> Path:
    return path.with_name(f"{path.name}.{number}")
