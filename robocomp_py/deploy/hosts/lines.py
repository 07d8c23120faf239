"""What a controller and the agent of a host tell each other: objects of JSON, one a line.

    to the agent      open · start · stop · kill · close · alive, as `do`
    from the agent    hello · opened · refused · started · failed · output · lost_lines · ready · status · left · hung ·
                      exited · usage · closed, as `tell`

Either side takes the other for gone when it has heard nothing for `SILENCE`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from ...errors import DeploymentError
from ..agents import Usage
from ..process import Member, Process

VERSION = 2

BEAT = 1.0
"""Seconds between two signs of life."""

SILENCE = 5.0
"""Seconds without any after which the other side is gone."""

LONGEST = 8 * 1024 * 1024
"""Octets of a line."""

LONGEST_TEXT = 4096
"""Characters of what people are shown of a text."""

Message = dict[str, Any]

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
    "hung": {"name": str},
    "exited": {"name": str, "code": int},
    "usage": {"of": dict},
    "closed": {},
}
"""What an agent tells, and what must be in it."""


def packed(message: Mapping[str, Any]) -> bytes:
    return json.dumps(message).encode() + b"\n"


class Misunderstood(DeploymentError):
    """What the other side says is none of ours."""


class Lines:
    """Takes what comes in pieces apart. Raises Misunderstood if it is none of ours."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[Message]:
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST:
            raise Misunderstood(f"a line of more than {LONGEST} octets")
        for line in filter(None, lines):
            yield unpacked(line)


def unpacked(line: bytes) -> Message:
    try:
        message = json.loads(line)
    except (ValueError, RecursionError) as exc:
        raise Misunderstood(f"what was said is not understood: {line[:80]!r}") from exc
    if not isinstance(message, dict):
        raise Misunderstood(f"what was said is not understood: {line[:80]!r}")
    return message


def heard(message: Message) -> Message:
    """What an agent tells, checked: it may be anybody's. Raises Misunderstood."""
    what = message.get("tell")
    parts = _TOLD.get(what) if isinstance(what, str) else None
    if parts is None or not all(isinstance(message.get(name), kind) for name, kind in parts.items()):
        raise Misunderstood(f"what the agent told is not understood: {str(message)[:80]!r}")
    return message


def shown(text: str) -> str:
    """As much of a text from a host as people are shown, without what would move things on their terminal."""
    return "".join(char if char.isprintable() or char in "\n\t" else " " for char in text[:LONGEST_TEXT])


def told(process: Process, command: tuple[str, ...], folder: str) -> Message:
    """A process, as the agent has to know it: with its command and its folder there."""
    return {
        "name": process.name,
        "component": process.component,
        "command": list(command),
        "cwd": folder,
        "env": dict(process.env),
        "notifies": process.notifies,
        "members": [[member.name, member.component] for member in process.members],
        "host": process.host,
        "grace": process.grace,
        "system": list(process.system),
    }


def process_of(told: Mapping[str, Any]) -> Process:
    """Raises DeploymentError."""
    try:
        return Process(
            str(told["name"]),
            str(told["component"]),
            tuple(map(str, told["command"])),
            Path(told["cwd"]),
            {str(name): str(value) for name, value in told["env"].items()},
            notifies=bool(told["notifies"]),
            members=tuple(Member(str(name), str(component)) for name, component in told["members"]),
            host=str(told["host"]),
            grace=None if told["grace"] is None else float(told["grace"]),
            system=tuple(map(str, told["system"])),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as exc:
        raise DeploymentError(f"a process is not understood: {exc}") from exc


_USAGE = tuple(each.name for each in fields(Usage))


def usage_told(usage: Mapping[str, Usage]) -> Message:
    return {name: [getattr(each, part) for part in _USAGE] for name, each in usage.items()}


def usage_of(told: Mapping[str, Any]) -> dict[str, Usage]:
    """Raises Misunderstood."""
    try:
        return {
            name: Usage(int(pid), float(cpu), int(memory), float(calls), float(worst), float(at))
            for name, (pid, cpu, memory, calls, worst, at) in told.items()
        }
    except (TypeError, ValueError, OverflowError, AttributeError) as exc:
        raise Misunderstood(f"what processes use is not understood: {exc}") from exc
