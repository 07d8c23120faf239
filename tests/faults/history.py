"""What happened, as events that are appended to files: what was written stays, also after `kill -9`.

Times are those of `time.monotonic`, which all processes of a host share, in network namespaces too.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeAlias


@dataclass(frozen=True, slots=True)
class Asked:
    """A client begins a call; `kind` is query, idempotent or command."""

    call: str
    kind: str
    deadline: float
    at: float


@dataclass(frozen=True, slots=True)
class Ended:
    """A call ended as `outcome`: ok, expired, or the name of what it raised; `server` is whose answer it was."""

    call: str
    outcome: str
    at: float
    server: str = ""


@dataclass(frozen=True, slots=True)
class Executed:
    """A server begins to execute a call."""

    call: str
    server: str
    at: float


@dataclass(frozen=True, slots=True)
class Published:
    """A publisher hands over its message of that number; numbers begin at 1 and have no gaps."""

    source: str
    number: int


@dataclass(frozen=True, slots=True)
class Heard:
    """A subscriber's sink gets a message."""

    subscriber: str
    source: str
    number: int


@dataclass(frozen=True, slots=True)
class Counted:
    """What a receiver says that it lost, when it is quiet: of messages, or of commands."""

    receiver: str
    lost: int


@dataclass(frozen=True, slots=True)
class Left:
    """A process of the run that is still there when nothing should be."""

    pid: int
    what: str


@dataclass(frozen=True, slots=True)
class Done:
    """A fault and its target: `kill`, `stop`, `cut` … until another one undoes it."""

    what: str
    whom: str
    at: float


Event: TypeAlias = Asked | Ended | Executed | Published | Heard | Counted | Left | Done

_KINDS: dict[str, type[Any]] = {
    kind.__name__: kind for kind in (Asked, Ended, Executed, Published, Heard, Counted, Left, Done)
}


class Journal:
    """Where one process writes. An event is a line, and one write, so that it is there whole or not at all."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)

    def note(self, event: Event) -> None:
        os.write(self._file, _line(event))

    def close(self) -> None:
        os.close(self._file)


def read(folder: Path) -> list[Event]:
    """What all processes wrote; of each in its order."""
    return [event for path in sorted(folder.glob("*.events")) for event in events(path.read_bytes())]


def events(written: bytes) -> Iterator[Event]:
    """A last line that is not whole belongs to who was killed in a write."""
    for line in written.split(b"\n")[:-1]:
        kind, fields = json.loads(line)
        yield _KINDS[kind](**fields)


def _line(event: Event) -> bytes:
    return json.dumps([type(event).__name__, asdict(event)], separators=(",", ":")).encode() + b"\n"
