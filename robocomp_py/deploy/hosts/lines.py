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

VERSION = 1

BEAT = 1.0
"""Seconds between two signs of life."""

SILENCE = 5.0
"""Seconds without any after which the other side is gone."""

LONGEST = 8 * 1024 * 1024
"""Octets of a line."""

Message = dict[str, Any]


def packed(message: Mapping[str, Any]) -> bytes:
    return json.dumps(message).encode() + b"\n"


class Lines:
    """Takes what comes in pieces apart. Raises DeploymentError if it is none of ours."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[Message]:
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST:
            raise DeploymentError(f"a line of more than {LONGEST} octets")
        for line in filter(None, lines):
            yield unpacked(line)


def unpacked(line: bytes) -> Message:
    try:
        message = json.loads(line)
    except (ValueError, RecursionError) as exc:
        raise DeploymentError(f"what was said is not understood: {line[:80]!r}") from exc
    if not isinstance(message, dict):
        raise DeploymentError(f"what was said is not understood: {line[:80]!r}")
    return message


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
    """Raises DeploymentError."""
    try:
        return {name: Usage(*values) for name, values in told.items()}
    except (TypeError, AttributeError) as exc:
        raise DeploymentError(f"what processes use is not understood: {exc}") from exc
