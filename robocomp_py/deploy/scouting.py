"""A scout: a process on another host that looks at what runs there, for one tool. See `tools.scout`.

Its lines are objects of JSON. They pass from the tool through the control socket, the connection to the agent of the
host and the agent, none of which looks into them.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Protocol, runtime_checkable

MOST = 8
"""Scouts that run on a host for one network at a time."""

LONGEST = 512 * 1024
"""Octets of a line."""

BEHIND = 2000
"""Lines that are kept for a tool which takes them too slowly."""

BEHIND_OCTETS = 8 * 1024 * 1024
"""Octets of those lines."""


class Scout:
    """A scout, as the controller of a network has it. To be used on its event loop only."""

    def __init__(self, say: Callable[[str], None], leave: Callable[[], None]) -> None:
        self._say, self._leave = say, leave
        self._lines: deque[str] = deque()
        self._octets = 0
        self.dropped = 0
        """Lines that did not fit since the last `taken`."""
        self.news = asyncio.Event()
        """Set when there are lines, and when it has ended."""
        self.has_ended = False
        self.why = ""
        """Why it has ended."""
        self.is_lost = False
        """Whether it has ended because its host is out of reach."""

    def say(self, line: str) -> None:
        if not self.has_ended:
            self._say(line)

    def taken(self) -> list[str]:
        """All its lines that nothing has taken so far."""
        lines = list(self._lines)
        self._lines.clear()
        self._octets = 0
        if not self.has_ended:
            self.news.clear()
        return lines

    def close(self) -> None:
        """End it. Idempotent."""
        if not self.has_ended:
            self.end("")
            self._leave()

    # What its host tells.

    def hear(self, line: str) -> None:
        if len(self._lines) < BEHIND and self._octets + len(line) <= BEHIND_OCTETS:
            self._lines.append(line)
            self._octets += len(line)
        else:
            self.dropped += 1
        self.news.set()

    def end(self, why: str, *, is_lost: bool = False) -> None:
        self.has_ended, self.why, self.is_lost = True, why, is_lost
        self.news.set()


@runtime_checkable
class Scouted(Protocol):
    """The agent of a host that has scouts."""

    def scout(self) -> Scout:
        """Start one. Raises HostUnreachable."""
