"""What an agent may take: how often, how long, and how much at a time. Pure."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...errors import RobocompError

MINUTE = 60.0


class Refused(RobocompError):
    """An agent asks for what it may not have; the text says what it may."""


@dataclass(frozen=True)
class Bounds:
    """The limits of one server."""

    calls_a_minute: int = 30
    reads_a_minute: int = 300
    longest: float = 30.0
    """Seconds that one request may take."""
    octets_out: int = 20_000
    """Characters of an answer as JSON."""
    octets_in: int = 65_536
    """Characters of the arguments as JSON."""
    messages: int = 20
    """Messages of a topic in one answer."""
    goals: int = 4
    """Goals at a time."""
    longest_goal: float = 600.0
    """Seconds after which a goal is cancelled at the latest."""

    def seconds(self, given: Any, name: str = "timeout", longest: float = 0.0) -> float:
        """A time that an agent asks for; at most `longest`, or else that of a request. Raises Refused."""
        most = longest or self.longest
        if isinstance(given, bool) or not isinstance(given, int | float) or not 0 < given <= most:
            raise Refused(f"{name}={given!r} is not a number of seconds above 0, up to {most:g}")
        return float(given)

    def count(self, given: Any) -> int:
        """A number of messages that an agent asks for. Raises Refused."""
        if isinstance(given, bool) or not isinstance(given, int) or not 1 <= given <= self.messages:
            raise Refused(f"count={given!r} is not a whole number from 1 to {self.messages}")
        return given


class Rate:
    """At most `most` in any minute. Not thread-safe."""

    def __init__(self, most: int, what: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._most, self._what, self._clock = most, what, clock
        self._times: deque[float] = deque(maxlen=most)

    def take(self) -> None:
        """Count one. Raises Refused, with the time to wait, if there were too many."""
        now = self._clock()
        while self._times and self._times[0] <= now - MINUTE:
            self._times.popleft()
        if len(self._times) == self._most:
            left = self._times[0] + MINUTE - now
            raise Refused(f"at most {self._most} {self._what} a minute; the next one in {left:.0f} s")
        self._times.append(now)


_ITEMS = (1000, 300, 100, 30, 10, 3, 1)
_TEXT = 2000


def fitted(value: Any, most: int) -> tuple[str, bool]:
    """A value as JSON of at most `most` characters, and whether its arrays and texts were cut for that."""
    text = json.dumps(value)
    if len(text) <= most:
        return text, False
    for items in _ITEMS:
        text = json.dumps(_cut(value, items))
        if len(text) <= most:
            return text, True
    return json.dumps(f"{text[: max(0, most - 100)]}…"[:most]), True


def _cut(value: Any, items: int) -> Any:
    """The same with at most `most` items in each array and object."""
    match value:
        case dict():
            kept = {str(key): _cut(each, items) for key, each in list(value.items())[: max(items, 30)]}
            return kept | ({"…": f"{len(value) - len(kept)} more"} if len(kept) < len(value) else {})
        case list():
            more = [f"… {len(value) - items} more"] if len(value) > items else []
            return [*(_cut(each, items) for each in value[:items]), *more]
        case str() if len(value) > _TEXT:
            return f"{value[:_TEXT]}… {len(value) - _TEXT} more"
        case _:
            return value
