"""Who waits is woken by a bell: one waits, many ring, and the number that is rung says what for."""

from __future__ import annotations

from collections.abc import Callable
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
        self._timed_wait: Callable[[Any], Any] = node.new_bell(name).timed_wait

    def wait(self, seconds: float) -> list[int]:
        """Wait until it rings, at most so long; what was rung since the last time, which may be nothing."""
        return [each.id.as_value for each in self._wait(iceoryx2.Duration.from_micros(max(1, int(seconds * 1e6))))]

    def rung(self, seconds: float) -> bool:
        """Wait likewise; whether it rang."""
        if seconds < SLICE:
            return bool(self._wait(iceoryx2.Duration.from_micros(max(1, int(seconds * 1e6)))))
        try:
            return bool(self._timed_wait(_SLICE))
        except iceoryx2.ListenerWaitError as exc:
            return _interrupted(exc)

    def _wait(self, duration: Any) -> Any:
        try:
            return self._timed_wait(duration)
        except iceoryx2.ListenerWaitError as exc:
            _interrupted(exc)
            return ()

    def close(self) -> None:
        self._timed_wait = _silence


def _silence(duration: Any) -> tuple[()]:
    return ()


def _interrupted(exc: Exception) -> bool:
    """False, if it was nothing but a signal; that is Python's business."""
    if str(exc) == "InterruptSignal":
        return False
    raise TransportError(f"shm: waiting: {exc}") from exc


class Rope:
    """By which another's bell is rung, from any thread."""

    def __init__(self, node: Node, name: str) -> None:
        self._notify: Callable[[Any], int] = node.bell(name).notify_with_custom_event_id

    def ring(self, number: int) -> bool:
        """Whether there is somebody to hear it."""
        try:
            return bool(self._notify(_NUMBERS[number]))
        except iceoryx2.NotifierNotifyError:
            return False

    def close(self) -> None:
        self._notify = _nobody


def _nobody(number: Any) -> int:
    return 0
