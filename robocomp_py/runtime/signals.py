"""Signals as calls on a thread of their own."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any


class Signals:
    """While entered, Ctrl-C, SIGTERM and SIGHUP (the terminal was closed) call a function.

    It is called on a thread of its own: the one that a signal interrupts may hold any lock. A
    second Ctrl-C has its usual effect.
    """

    def __init__(self, handle: Callable[[int], None]) -> None:
        self._handle = handle
        self._before: dict[int, Any] = {}
        self._out, self._in = os.pipe()
        self._thread = threading.Thread(target=self._pass_on, name="signals")

    def __enter__(self) -> None:
        self._thread.start()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            self._before[number] = signal.signal(number, self._received)

    def __exit__(self, *exc: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)
        os.close(self._in)
        self._thread.join()
        os.close(self._out)

    def _received(self, number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, self._before[signal.SIGINT])
        os.write(self._in, bytes([number]))

    def _pass_on(self) -> None:
        while received := os.read(self._out, 1):
            self._handle(received[0])
