"""Sends the messages of a replay when they are due, and does what keys say meanwhile."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol

from .ahead import Upcoming
from .pace import Pace

LATEST = 100_000
"""Messages whose delays are kept."""

_STALL = 1_000_000_000
"""ns. A replay that is later than this, because a subscriber or the machine held it up, goes on from where it is. It
does not catch up, since a burst of old messages is of no use."""

_REFRESH = 200_000_000
"""ns between two calls of `show`."""

_FASTER, _SLOWER = 2.0, 0.5

KEYS = "space pauses, s sends the next message, + and - change the rate"


class Keys(Protocol):
    def wait(self, seconds: float) -> str:
        """The key that is pressed in this time; empty if none is."""
        ...


class Delays(NamedTuple):
    """How late messages were sent, in seconds. Steps are not counted."""

    median: float
    p99: float
    longest: float
    held_up: float
    """In total, in pauses that the replay did not choose."""


class Player:
    """One replay. `send` takes a topic and the data of a message; `show` is called a few times a second."""

    def __init__(
        self,
        pace: Pace,
        keys: Keys,
        send: Callable[[str, bytes], object],
        show: Callable[[Pace, int], object],
        now: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.pace, self._keys, self._send, self._show, self._now = pace, keys, send, show, now
        self.sent = 0
        self._late: deque[int] = deque(maxlen=LATEST)
        self._longest = self._held_up = 0
        self._is_step = False
        self._shown = now()

    def play(self, messages: Iterable[Upcoming]) -> None:
        """Send these messages, the first position being now."""
        is_begun = False
        for each in messages:
            if not is_begun:
                self.pace.jump(0, self._now())
                is_begun = True
            self._wait(each.position)
            self._send(each.topic, each.data)
            self.sent += 1

    @property
    def delays(self) -> Delays:
        late = sorted(self._late) or [0]
        quantiles = (late[len(late) // 2], late[min(len(late) - 1, len(late) * 99 // 100)], self._longest)
        return Delays(*(each / 1e9 for each in (*quantiles, self._held_up)))

    def _wait(self, position: int) -> None:
        """Until the message of this position is to be sent."""
        while True:
            now = self._now()
            if now - self._shown >= _REFRESH:
                self._shown = now
                self._show(self.pace, now)
                self._press(self._keys.wait(0.0))  # also if there is never time to wait
            if self._is_step:
                self._is_step = False
                self.pace.jump(position, now)
                return
            due = self.pace.due(position)
            if due is not None and due <= now:
                self._note(now - due, position, now)
                return
            self._press(self._keys.wait(min(due - now if due is not None else _REFRESH, _REFRESH) / 1e9))

    def _note(self, late: int, position: int, now: int) -> None:
        if late > _STALL:
            self._held_up += late
            self.pace.jump(position, now)
        else:
            self._late.append(late)
            self._longest = max(self._longest, late)

    def _press(self, key: str) -> None:
        now = self._now()
        match key:
            case " ":
                self.pace.toggle(now)
            case "s":
                if not self.pace.is_paused:
                    self.pace.toggle(now)
                self._is_step = True
            case "+" | "=":
                self.pace.change_rate(_FASTER, now)
            case "-":
                self.pace.change_rate(_SLOWER, now)
            case _:
                return
        self._shown = 0
