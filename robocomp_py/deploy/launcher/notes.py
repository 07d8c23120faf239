"""What a process says of itself, as systemd's sd_notify(3) defines it. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from ...runtime.notify import CALLS, ENDED

MAX = 4096
"""Bytes of a datagram that are looked at."""

_STATUS = 200
"""Characters of a status that are told."""


@dataclass
class Note:
    """One datagram. What is not known, or nonsense, is passed over."""

    ready: bool = False
    reloading: bool = False
    stopping: bool = False
    status: str | None = None
    fed: bool = False
    stuck: bool = False
    """It says itself that it is (`WATCHDOG=trigger`)."""
    watchdog_s: float | None = None
    """How long it may be silent from now on; 0 is as long as it likes."""
    main_pid: int | None = None
    access: Literal["", "none", "main", "all"] = ""
    """Whose datagrams count from now on."""
    ended: list[str] = field(default_factory=list)
    """Components in it that have ended."""
    calls: tuple[float, float] | None = None
    """Operations answered per second, and how many milliseconds the slowest one took."""


def read(datagram: bytes) -> Note:
    note = Note()
    for line in datagram[:MAX].decode(errors="replace").split("\n"):
        key, found, value = line.partition("=")
        if found:
            _heed(note, f"{key}=", value)
    return note


def _heed(note: Note, key: str, value: str) -> None:
    match key:
        case "READY=":
            note.ready = note.ready or value == "1"
        case "RELOADING=":
            note.reloading = value == "1"
        case "STOPPING=":
            note.stopping = note.stopping or value == "1"
        case "STATUS=":
            note.status = "".join(each if each.isprintable() else " " for each in value[:_STATUS])
        case "WATCHDOG=":
            note.fed, note.stuck = note.fed or value == "1", note.stuck or value == "trigger"
        case "WATCHDOG_USEC=":
            if value.isdecimal() and value.isascii():
                note.watchdog_s = int(value[:20]) / 1e6
        case "MAINPID=":
            if value.isdecimal() and value.isascii() and len(value) < 10:
                note.main_pid = int(value)
        case "NOTIFYACCESS=":
            note.access = _ACCESS.get(value, note.access)
        case _ if key == ENDED:
            note.ended.append(value)
        case _ if key == CALLS:
            note.calls = _numbers(value) or note.calls


_ACCESS: dict[str, Literal["none", "main", "all"]] = {"none": "none", "main": "main", "exec": "main", "all": "all"}


def _numbers(text: str) -> tuple[float, float] | None:
    try:
        per_s, worst = map(float, text.split())
    except ValueError:
        return None
    return (per_s, worst) if math.isfinite(per_s) and math.isfinite(worst) and min(per_s, worst) >= 0 else None
