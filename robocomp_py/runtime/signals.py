"""Signals as function calls on a separate thread."""

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
"""Flag in the numbers that Python's own handler writes to the pipe."""

_END = b"\0"
"""Ends the thread; no signal has this number."""

_entered: list[Signals] = []


class Signals:
    """While entered, Ctrl-C, SIGTERM and SIGHUP (the terminal was closed) call a function.

    The function is called at once, on a separate thread. Python runs signal handlers only on the main thread, between
    two bytecodes, and that thread may hold any lock or be in a long wait. A second Ctrl-C has its usual effect. Child
    processes that are forked meanwhile handle signals as before.

    `besides` is also called, on the main thread, by Python's own handler. Native code that keeps the GIL for long, such
    as a search by a regular expression, lets no other thread run, but checks for signals.
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
        # Last: a signal before this line may still raise an exception here; later ones call the function.
        if not start_thread(self._thread):
            _forget()
            raise ComponentError(f"signals cannot be received: {NO_THREAD}")

    def __exit__(self, *exc: object) -> None:
        if self not in _entered:
            return  # in a forked child, where `_forget` has restored the handlers
        try:
            _entered.remove(self)
        finally:  # a second Ctrl-C may raise an exception anywhere here
            try:
                self._restore()
            finally:
                os.write(self._in, _END)  # closing the pipe would not do: a forked child may have it open, too
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
            if late and number in told:  # already received through the wakeup descriptor
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
