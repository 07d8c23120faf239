"""Log records for a launcher: one line each, in the pipe that also carries what a component prints.

    \\x1e{"time": 1771930800.25, "level": "WARNING", "logger": "wander", "instance": "wander", "thread": "compute",
         "file": "…/specificworker.py", "line": 41, "text": "too close"}

A record that belongs to a trace also has `trace`.

A line is ASCII and has at most LONGEST characters, so it arrives in one piece: a pipe takes it at once. The traceback
of an exception belongs to the text of its record. Readers distrust these lines, as any program can write one.
"""

from __future__ import annotations

import json
import logging
import math
import os
import stat
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

MARK = "\x1e"
"""The first character of a record. JSON has none in it, so a record may also follow an unfinished line of text."""

WANTED = "ROBOCOMP_RECORDS"
"""The environment variable by which a launcher asks for records on standard error."""

LONGEST = 4000
"""Characters of a line. The middle of a longer text is left out."""

LEVELS = {"DEBUG": 10, "INFO": 20, "WARNING": 30, "ERROR": 40, "CRITICAL": 50}

_NAME = 100
"""Characters of a name that are told; of a path, twice as many."""

_GAP = " […] "

_LAST_SECOND = 253402300799.0
"""Of the year 9999, the last that Python can name."""


def wanted() -> bool:
    """Whether a launcher reads records from standard error. False if that leads somewhere else, such as to a file."""
    if WANTED not in os.environ:
        return False
    try:
        return stat.S_ISFIFO(os.fstat(2).st_mode)
    except OSError:
        return False


class RecordFormatter(logging.Formatter):
    """`instance` returns the component that logs a record; it is called on the thread that logs."""

    def __init__(self, instance: Callable[[logging.LogRecord], str]) -> None:
        super().__init__("%(message)s")
        self._instance = instance

    def format(self, record: logging.LogRecord) -> str:
        told: dict[str, Any] = {
            "time": round(record.created, 6),
            "level": _level(record.levelno),
            "logger": record.name[:_NAME],
            "instance": self._instance(record)[:_NAME],
            "thread": (record.threadName or "")[:_NAME],
            "file": record.pathname[-2 * _NAME :],
            "line": record.lineno,
            "text": "",
        }
        if trace := _trace(record):
            told["trace"] = trace[:_NAME]
        room = LONGEST - len(MARK) - len(json.dumps(told))
        return MARK + json.dumps(told | {"text": _shortened(super().format(record), room)})


@dataclass(frozen=True, slots=True)
class Record:
    time: float
    """Seconds since the Unix epoch, by the clock of its host."""
    level: str
    """One of LEVELS."""
    logger: str
    instance: str
    thread: str
    file: str
    line: int
    text: str
    trace: str = ""
    """The id of the trace that it belongs to, if it has one."""


def read(line: str) -> Record | None:
    """The record of a line; None if it is something else."""
    if not line.startswith(MARK) or len(line) > LONGEST:
        return None
    try:
        found = json.loads(line[len(MARK) :])
    except (ValueError, RecursionError):
        return None
    return record_of(found)


def record_of(told: Any) -> Record | None:
    """A record as JSON has it, with the fields of `Record`; None if it is something else."""
    if not isinstance(told, dict) or told.keys() | {"trace"} != _FIELDS.keys():
        return None
    if not all(_FIELDS[name](value) for name, value in told.items()):
        return None
    return Record(**told)


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


_FIELDS: dict[str, Callable[[Any], bool]] = {
    "time": lambda value: type(value) in (int, float) and math.isfinite(value) and 0 <= value <= _LAST_SECOND,
    "level": lambda value: _is_text(value) and value in LEVELS,
    "logger": _is_text,
    "instance": _is_text,
    "thread": _is_text,
    "file": _is_text,
    "line": lambda value: type(value) is int and abs(value) < 1 << 31,
    "text": _is_text,
    "trace": _is_text,
}


def _trace(record: logging.LogRecord) -> str:
    """As given by `log.info("…", extra={"trace": "…"})`, or by OpenTelemetry's instrumentation of `logging`."""
    found = getattr(record, "trace", None) or getattr(record, "otelTraceID", None)
    return found if isinstance(found, str) and found != "0" else ""


def _level(number: int) -> str:
    """The name of a level; that of the next lower one if it has none of its own."""
    return max((name for name, each in LEVELS.items() if each <= number), key=LEVELS.__getitem__, default="DEBUG")


def _shortened(text: str, room: int) -> str:
    """A text of at most `room` characters in JSON: its beginning, and more of its end, where an error is named."""
    keep, shown = min(len(text), room), text
    while True:
        if keep < len(text):
            head = keep // 4
            shown = text[:head] + _GAP + text[len(text) - (keep - head) :]
        size = len(json.dumps(shown)) - 2
        if size <= room:
            return shown
        keep = min(keep - 1, keep * room // size)
