"""The output of a network's processes in files: one for each, rotated when it is long.

    logs/laser.log  laser.log.1  laser.log.2        the newest first
    2026-03-01T12:00:00.123456+00:00 WARNING: too close      as text; further lines of a record begin with a tab
    {"time": "…", "name": "laser", "level": "warning", "text": "too close", …}  as JSON, a line each, see `told`

A full disk does not stop the network. It is reported once, lost lines are counted, and their number is written when
there is room again.
"""

from __future__ import annotations

import contextlib
import errno
import json
import logging
import os
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from ..errors import DeploymentError
from ..runtime.records import LEVELS, Record, record_of
from .harmless import plain
from .place import file_name
from .ring import Line

log = logging.getLogger("robocomp.deploy")

AGENT = "rc-mcp"
"""The log of `rc mcp`, which writes it itself; no process of a network can have this name."""

KEPT = 2
"""Files of each that are kept beside the newest."""

_ALTOGETHER = 256 << 20
"""Approximate bytes of all files of a network; each has its share."""

_SMALLEST, _LARGEST = 64 << 10, 8 << 20
"""Bytes of a file."""

_ANY_NUMBER = 1 << 62

_TOGETHER = "\r"
"""Stands for _FURTHER while lines are told apart; `plain` leaves none in a file."""

_FURTHER = "\n\t"
"""Between the lines of a record, in files of text."""


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
        if self._form is Form.JSON:
            return json.dumps(told(line)).encode() + b"\n"
        text = plain(line.text).replace("\n", _FURTHER)
        return f"{_when(line.at)} {text}\n".encode(errors="replace")

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


def told(line: Line) -> Mapping[str, Any]:
    """A line for machines. What a component logged also has the time by its own clock, instance, place and thread."""
    record = line.record
    facts = {"time": _when(line.at), "name": line.name, "level": line.level.lower(), "text": plain(line.message)}
    if record is None:
        return facts
    trace = {"trace": plain(record.trace)} if record.trace else {}
    return (
        facts
        | trace
        | {
            "logged": _when(record.time),
            "instance": plain(record.instance),
            "logger": plain(record.logger),
            "thread": plain(record.thread),
            "file": plain(record.file),
            "line": record.line,
        }
    )


def past_lines(
    folder: Path,
    names: Collection[str],
    count: int,
    since: float = 0.0,
    wanted: Callable[[Line], bool] | None = None,
) -> list[Line]:
    """The newest lines in the files of these processes (of all, if none is named), in the order in which they came.

    Lines from before `since`, which belong to an earlier run, are left out, and those for which `wanted` is false.
    """
    read = count if wanted is None else _ANY_NUMBER
    found = [_read(name, text) for name in logged_names(folder, names) for text in _tail(folder / f"{name}.log", read)]
    found = [line for line in found if line.at >= since and (wanted is None or wanted(line))]
    found.sort(key=lambda line: line.at)
    return found[-count:] if count else []


def growing_lines(
    folder: Path, name: str, count: int, since: float, wanted: Callable[[Line], bool], goes_on: Callable[[], bool]
) -> Iterator[Line]:
    """The newest lines in the file of one process, and new ones as they come, for as long as `goes_on`."""
    path, size, last = folder / f"{file_name(name)}.log", -1, since
    past = past_lines(folder, [name], count, since, wanted)
    yield from past
    last = max((each.at for each in past), default=since)
    while goes_on():
        with contextlib.suppress(OSError):  # it is being turned over
            if (now := path.stat().st_size) != size:
                size = now
                new = [each for each in past_lines(folder, [name], _ANY_NUMBER, last) if each.at > last]
                last = max((each.at for each in new), default=last)
                yield from filter(wanted, new)


def logged_names(folder: Path, names: Collection[str] = ()) -> list[str]:
    """The names of log files that belong to these processes and systems (to any, if none is named)."""
    chosen = {file_name(name) for name in names}
    there = sorted(path.stem for path in folder.glob("*.log"))
    return [stem for stem in there if not chosen or any(f"{stem}.".startswith(f"{name}.") for name in chosen)]


def _read(name: str, written: str) -> Line:
    """A line of a file. A line of another program has no time and counts as the oldest."""
    if written.startswith("{"):
        with contextlib.suppress(ValueError, KeyError, TypeError, RecursionError):
            facts = json.loads(written)
            level, text = str(facts["level"]).upper(), str(facts["text"])
            at = _seconds(str(facts["time"]))
            record = _record(facts, level) if level in LEVELS else None
            whose = f"{record.instance}: " if record and record.instance not in ("", facts["name"]) else ""
            return Line(at, name, f"{level}: {whose}{text}" if level else text, record)
    when, _, text = written.partition(" ")
    with contextlib.suppress(ValueError):
        return Line(_seconds(when), name, text)
    return Line(0.0, name, written)


def _record(facts: Mapping[str, Any], level: str) -> Record | None:
    """Of a line as `told` writes it; None if it was printed."""
    if "logged" not in facts:
        return None
    return record_of(
        {name: facts.get(name) for name in ("logger", "instance", "thread", "file", "line", "text")}
        | {"time": _seconds(str(facts["logged"])), "level": level, "trace": facts.get("trace", "")}
    )


def _when(at: float) -> str:
    return datetime.fromtimestamp(at, UTC).isoformat(timespec="microseconds")


def _seconds(when: str) -> float:
    return datetime.fromisoformat(when).timestamp()


def _tail(path: Path, count: int) -> list[str]:
    """The last lines of a file, and of those before it as far as it takes. A record is one line here."""
    lines: list[str] = []
    for file in (path, *(_numbered(path, number) for number in range(1, KEPT + 1))):
        if len(lines) >= count:
            break
        with contextlib.suppress(OSError):
            written = file.read_bytes().decode(errors="replace").replace(_FURTHER, _TOGETHER)
            lines = [*(each.replace(_TOGETHER, "\n") for each in written.split("\n")[:-1]), *lines]
    return lines[-count:]


def _numbered(path: Path, number: int) -> Path:
    return path.with_name(f"{path.name}.{number}")
