"""Who waits is woken by a bell: one waits, many ring, and the number that is rung says what for."""

from __future__ import annotations

from typing import Any

import iceoryx2

from ...errors import TransportError
from .node import BELLS, Node

MAIL = 0
"""There is something in the queue that belongs to the bell."""

LOOK = BELLS - 1
"""The directory has changed."""


def bell_of(number: int) -> int:
    """What is rung for the link of that number. Several may share one."""
    return 1 + number % (BELLS - 2)


SLICE = 0.05
"""Seconds after which somebody who waits for one thing looks whether there is still a point in it."""

_SLICE = iceoryx2.Duration.from_micros(int(SLICE * 1e6))

_NUMBERS = [iceoryx2.EventId.new(number) for number in range(BELLS)]


class Bell:
    """Ours."""

    def __init__(self, node: Node, name: str) -> None:
        self._listener: Any = node.new_bell(name)

    def wait(self, seconds: float) -> list[int]:
        """Wait until it rings, at most so long; what was rung since the last time, which may be nothing."""
        return [each.id.as_value for each in self._wait(iceoryx2.Duration.from_micros(max(1, int(seconds * 1e6))))]

    def rung(self, seconds: float) -> bool:
        """Wait likewise; whether it rang."""
        duration = _SLICE if seconds >= SLICE else iceoryx2.Duration.from_micros(max(1, int(seconds * 1e6)))
        return bool(self._wait(duration))

    def _wait(self, duration: Any) -> Any:
        listener = self._listener
        if listener is None:
            return ()
        try:
            return listener.timed_wait(duration)
        except iceoryx2.ListenerWaitError as exc:
            if str(exc) == "InterruptSignal":
                return ()
            raise TransportError(f"shm: waiting: {exc}") from exc

    def close(self) -> None:
        self._listener = None


class Rope:
    """By which another's bell is rung, from any thread."""

    def __init__(self, node: Node, name: str) -> None:
        self._notifier: Any = node.bell(name)

    def ring(self, number: int) -> bool:
        """Whether there is somebody to hear it."""
        notifier = self._notifier
        if notifier is None:
            return False
        try:
            return bool(notifier.notify_with_custom_event_id(_NUMBERS[number]))
        except iceoryx2.NotifierNotifyError:
            return False

    def close(self) -> None:
        self._notifier = None
