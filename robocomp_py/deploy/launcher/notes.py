"""What a process says of itself, as systemd's sd_notify(3) defines it. Pure."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Literal

from ...runtime.notify import CALLS, CONTRACT, ENDED, LIFE
from ..agents import Life

MAX = 16384
"""Bytes of a datagram that are looked at."""

MOST_OPERATIONS = 20_000
"""A component that has more says nothing of its contracts that is understood."""

_STATUS = 200
"""Characters of a status that are told."""


@dataclass
class Contract:
    """What a component in it says of its contracts: one datagram may hold a part."""

    instance: str
    count: int
    """How many operations it has in all."""
    operations: dict[str, str]

    @property
    def complete(self) -> bool:
        return len(self.operations) == self.count

    def add(self, more: Contract) -> None:
        """Add another part; what is too much is nonsense, and passed over."""
        self.count = more.count
        room = max(0, min(self.count, MOST_OPERATIONS) - len(self.operations))
        for name in list(more.operations)[:room]:
            self.operations[name] = more.operations[name]


@dataclass
class Note:
    """One datagram. What is not known, or nonsense, is passed over."""

    ready: bool = False
    stopping: bool = False
    status: str | None = None
    fed: bool = False
    stuck: bool = False
    """It says itself that it is (`WATCHDOG=trigger`)."""
    watchdog_s: float | None = None
    """Seconds that it may be silent from now on; 0 is without limit."""
    main_pid: int | None = None
    access: Literal["", "none", "main", "all"] = ""
    """Whose datagrams count from now on."""
    ended: list[str] = field(default_factory=list)
    """Components in it that have ended."""
    contracts: list[Contract] = field(default_factory=list)
    lives: dict[str, Life] = field(default_factory=dict)
    """By component in it, how it is."""
    calls: tuple[float, float] | None = None
    """Operations answered per second, and how many milliseconds the slowest one took."""


def read(datagram: bytes) -> Note:
    note = Note()
    for line in datagram[:MAX].decode(errors="replace").split("\n"):
        key, found, value = line.partition("=")
        if found:
            _read(note, f"{key}=", value)
    return note


def _read(note: Note, key: str, value: str) -> None:
    match key:
        case "READY=":
            note.ready = note.ready or value == "1"
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
        case _ if key == CONTRACT:
            name, count, *operations = (*value.split(" "), "")
            if _COUNT.fullmatch(count):
                found = dict(each.split("=") for each in operations if _OPERATION.fullmatch(each))
                note.contracts.append(Contract(name, int(count), found))
        case _ if key == LIFE:
            if life := _LIFE.fullmatch(value):
                overruns, missed, lost = (int(life[name]) for name in ("overruns", "missed", "lost"))
                note.lives[life["name"]] = Life(life["state"], overruns, missed, lost, life["version"])
        case _ if key == CALLS:
            note.calls = _numbers(value) or note.calls


_ACCESS: dict[str, Literal["none", "main", "all"]] = {"none": "none", "main": "main", "exec": "main", "all": "all"}


_OPERATION = re.compile(r"[\w:.]+=[0-9a-f]{16}")
_COUNT = re.compile(r"[0-9]{1,9}")
_LIFE = re.compile(
    r"(?P<name>[^\s]{1,200}) (?P<state>[a-z]{1,20}) (?P<overruns>[0-9]{1,18}) (?P<missed>[0-9]{1,18}) "
    r"(?P<lost>[0-9]{1,18}) (?P<version>[0-9A-Za-z.+-]{1,40})"
)


def _numbers(text: str) -> tuple[float, float] | None:
    try:
        per_s, worst = map(float, text.split())
    except ValueError:
        return None
    return (per_s, worst) if math.isfinite(per_s) and math.isfinite(worst) and min(per_s, worst) >= 0 else None
