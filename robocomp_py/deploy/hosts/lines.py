"""The messages between a controller and the agent of a host: objects of JSON, one a line.

    to the agent      open · start · stop · kill · close · alive · scout · scout_line · scout_end, as `do`
    from the agent    hello · opened · refused · started · failed · output · lost_lines · ready · status · left ·
                      contract · hung · exited · usage · closed · scout_line · scout_end, as `tell`

A scout looks at what runs on the host, for a tool; see `scouting.py`. `id` tells which one is meant.

Either side considers the other gone after `SILENCE` without a message.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

from ...errors import DeploymentError
from ..agents import Life, Usage
from ..asjson import from_json, to_json
from ..process import Process

VERSION = 6

BEAT = 1.0
"""Seconds between two signs of life."""

SILENCE = 5.0
"""Seconds without any after which the other side is gone."""

LONGEST = 8 * 1024 * 1024
"""Octets of a line of a controller, which contains environments."""

LONGEST_TOLD = 1024 * 1024
"""Octets of a line of an agent, which may be hostile. Its objects in memory take up to thirty times as much."""

LONGEST_TEXT = 4096
"""Maximum number of characters of a text that is shown to users."""

_LARGEST = 2**63
"""No number of a host is larger: we calculate with floating-point numbers, and show the results."""

Message = dict[str, Any]

N = TypeVar("N", int, float)

_TOLD: Mapping[str, Mapping[str, type]] = {
    "boot": {"there": bool, "root": str, "python": str, "folder": str},
    "hello": {"version": int, "kept": list},
    "opened": {},
    "refused": {"why": str},
    "started": {"name": str},
    "failed": {"name": str, "why": str},
    "output": {"name": str, "line": str},
    "lost_lines": {"count": int},
    "ready": {"name": str},
    "status": {"name": str, "text": str},
    "left": {"name": str, "instance": str},
    "contract": {"name": str, "instance": str, "operations": dict},
    "hung": {"name": str},
    "exited": {"name": str, "code": int},
    "usage": {"of": dict},
    "closed": {},
    "scout_line": {"id": int, "line": str},
    "scout_end": {"id": int, "why": str},
}
"""The messages of an agent, and their required fields."""


def packed(message: Mapping[str, Any]) -> bytes:
    return json.dumps(message).encode() + b"\n"


class Misunderstood(DeploymentError):
    """A message of the other side is malformed."""


class Lines:
    """Splits a stream into lines. Raises Misunderstood if it is not one of ours."""

    def __init__(self, longest: int) -> None:
        """`longest`: octets that a line may have."""
        self._longest, self._rest = longest, bytearray()

    def feed(self, data: bytes) -> Iterator[Message]:
        self._rest += data
        lines: list[bytearray] = []
        if b"\n" in data:
            *lines, self._rest = self._rest.split(b"\n")
        if any(len(line) > self._longest for line in (*lines, self._rest)):
            raise Misunderstood(f"a line of more than {self._longest} octets")
        for line in filter(None, lines):
            yield unpacked(line)


def unpacked(line: bytes | bytearray) -> Message:
    try:
        message = json.loads(line)
    except (ValueError, RecursionError) as exc:
        raise Misunderstood(f"malformed message: {bytes(line[:80])!r}") from exc
    if not isinstance(message, dict):
        raise Misunderstood(f"malformed message: {bytes(line[:80])!r}")
    return message


def heard(message: Message) -> Message:
    """A message of an agent, checked, since it may come from any program. Raises Misunderstood."""
    what = message.get("tell")
    parts = _TOLD.get(what) if isinstance(what, str) else None
    if parts is None or not all(_is(message.get(name), kind) for name, kind in parts.items()):
        raise Misunderstood(f"malformed message of the agent: {str(message)[:80]!r}")
    return message


def _is(value: Any, kind: type) -> bool:
    return isinstance(value, kind) and not (isinstance(value, int) and abs(value) >= _LARGEST)


def shown(text: str) -> str:
    """A text from a host as it is shown to users: shortened, without control characters."""
    return "".join(char if char.isprintable() or char in "\n\t" else " " for char in text[:LONGEST_TEXT])


def told(process: Process, command: tuple[str, ...], folder: str) -> Message:
    """A process for the agent, with its command and its folder there.

    The fields that only its supervisor needs are left out. A process with changed fields is started anew.
    """
    message: Message = to_json(replace(process, command=command, cwd=Path(folder)))
    return {name: value for name, value in message.items() if name not in _OF_ITS_SUPERVISOR}


_OF_ITS_SUPERVISOR = {"after", "restart", "ready_after", "stops_before", "files", "is_program"}


def process_of(told: Any) -> Process:
    """Raises DeploymentError."""
    try:
        return from_json(Process, told)
    except ValueError as exc:
        raise DeploymentError(f"malformed process: {exc}") from exc


def usage_told(usage: Mapping[str, Usage]) -> Message:
    return {name: list(asdict(each).values()) for name, each in usage.items()}


def usage_of(told: Mapping[str, Any]) -> dict[str, Usage]:
    """Raises Misunderstood."""
    try:
        return {
            name: Usage(
                _number(int(pid)),
                _number(float(cpu)),
                _number(int(memory)),
                _number(float(calls)),
                _number(float(worst)),
                _number(float(at)),
                _lives(lives),
            )
            for name, (pid, cpu, memory, calls, worst, at, lives) in told.items()
        }
    except (TypeError, ValueError, OverflowError, AttributeError, KeyError) as exc:
        raise Misunderstood(f"malformed usage of processes: {exc}") from exc


def _lives(told: Mapping[str, Any]) -> dict[str, Life]:
    """Raises the errors that `usage_of` expects for malformed input."""
    return {
        shown(name): Life(
            shown(str(life["state"])),
            _number(int(life["overruns"])),
            _number(int(life["missed"])),
            _number(int(life["lost"])),
            shown(str(life["version"])),
        )
        for name, life in told.items()
    }


def _number(value: N) -> N:
    """The same. Raises ValueError if it is not a number, or too large to be real."""
    if not abs(value) < _LARGEST:
        raise ValueError("a number is too large")
    return value
