"""What a transport tells a tool of its process: `{"transport": "00a1…", "owner": "robot1/world", "pid": 71}`."""

from __future__ import annotations

import json
import os

WHO = "who"
"""The last part of the key of the question."""

_LONGEST = 4096
"""Octets of an answer that are read."""


def who(transport: int, owner: str) -> bytes:
    """The answer."""
    return json.dumps({"transport": f"{transport:010x}", "owner": owner, "pid": os.getpid()}).encode()


def owner_of(answer: bytes) -> dict[int, str]:
    """The owner by the number of its transport; empty if this is no such answer."""
    try:
        told = json.loads(answer) if len(answer) <= _LONGEST else None
        number, owner = int(told["transport"], 16), told["owner"]  # type: ignore[index]  # a TypeError is handled
    except (ValueError, TypeError, KeyError, RecursionError):
        return {}
    return {number: owner} if isinstance(owner, str) and owner.isprintable() else {}
