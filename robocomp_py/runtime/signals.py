"""Signals as calls on a thread of their own."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

from ..errors import ComponentError
from ..threads import NO_THREAD, start_thread

_ENDING = signal.SIGINT, signal.SIGTERM, signal.SIGHUP

_LATE = 0x80
"""What is added to a number that Python's own handler passes on."""

_END = b"\0"
"""What ends the thread; no signal has this number."""

_entered: list[Signals] = []


class Signals:
    """While entered, Ctrl-C, SIGTERM and SIGHUP (the terminal was closed) call a function.

    It is called on a thread of its own, and at once: the thread that a signal interrupts may hold any lock, or be about
    to wait for long, and Python tells it of signals only between two of its steps. A second Ctrl-C has its usual
    effect. Processes that are forked meanwhile take signals as before.

    `besides` is called on the main thread, too, where Python itself takes a signal: code that holds Python's lock for
    long, as a search by a regular expression, lets no other thread run, but looks for signals.
    """

    def __init__(self, handle: Callable[[int], None], besides: Callable[[], object] = lambda: None) -> None:
        self._handle, self._besides = handle, besides
        self._before: dict[int, Any] = {}
        self._woken_before = -1
        self._out, self._in = os.pipe()
        os.set_blocking(self._in, False)
        self._thread = threading.Thread(target=self._pass_on, name="signals")

    def __enter__(self) -> None:
        for number in _ENDING:
            self._before[number] = signal.signal(number, self._received)
        self._woken_before = signal.set_wakeup_fd(self._in, warn_on_full_buffer=False)
        _entered.append(self)
        # Last: until then a signal may raise something here, and is told of from now on.
        if not start_thread(self._thread):
            _forget()
            raise ComponentError(f"signals cannot be received: {NO_THREAD}")

    def __exit__(self, *exc: object) -> None:
        if self not in _entered:
            return  # this process was forked meanwhile, and all is as before already
        try:
            _entered.remove(self)
        finally:  # a second Ctrl-C raises something here; and once all is restored, so may any signal
            try:
                self._restore()
            finally:
                os.write(self._in, _END)  # what was forked meanwhile may have the pipe open, too
                self._thread.join()
                self._close()

    def _close(self) -> None:
        os.close(self._in)
        os.close(self._out)

    def _restore(self) -> None:
        signal.set_wakeup_fd(self._woken_before)
        for number, before in self._before.items():
            signal.signal(number, before)

    def _received(self, number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, self._before[signal.SIGINT])
        self._besides()
        os.write(self._in, bytes([number | _LATE]))

    def _pass_on(self) -> None:
        told: set[int] = set()
        while (received := os.read(self._out, 1)) != _END:
            late, number = received[0] & _LATE, received[0] & ~_LATE
            if late and number in told:  # it came by the descriptor, unless somebody else has put one in its place
                told.remove(number)
            elif number in _ENDING:
                if not late:
                    told.add(number)
                self._handle(number)


def _forget() -> None:
    while _entered:
        signals = _entered.pop()
        signals._restore()
        signals._close()


os.register_at_fork(after_in_child=_forget)
