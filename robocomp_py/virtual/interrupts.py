"""Signals that come while threads take turns take effect when these stand still.

A handler that raises, such as that of Ctrl-C, would otherwise interrupt the main thread between any two steps, also in
the middle of a hand-over to another thread.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Self

_DEFERRED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
"""Those for which `_receive` stands. Setting one takes a system call, so they are not set in each run."""

_open: set[Interrupts] = set()
_entered: list[Interrupts] = []


class Interrupts:
    """While entered on the main thread, a signal calls `stop`. Its handler is called when this is left without error.

    A second signal calls its handler at once. May be entered again, but not within itself.
    """

    def __init__(self, stop: Callable[[], object]) -> None:
        self.stop = stop
        self.received = 0
        """The first signal that came since this was entered; 0 if none did."""

    def __enter__(self) -> Self:
        self.received = 0
        if threading.current_thread() is threading.main_thread():
            if self not in _open:
                _open.add(self)
                _set_handlers()
            _entered.append(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self in _entered:
            _entered.remove(self)
        if self.received and kind is None:
            _handlers[self.received](self.received, None)

    def close(self) -> None:
        """Forget this. The last one restores the handlers. Idempotent."""
        _open.discard(self)
        if not _open and threading.current_thread() is threading.main_thread():
            _restore_handlers()


def _set_handlers() -> None:
    for number in _DEFERRED:
        handler = signal.getsignal(number)
        if callable(handler) and number not in _handlers:
            _handlers[number] = handler
            signal.signal(number, _receive)


def _restore_handlers() -> None:
    for number in list(_handlers):
        if signal.getsignal(number) is _receive:  # otherwise another one was set, which may call this one
            signal.signal(number, _handlers[number])
            del _handlers[number]


def _receive(number: int, frame: FrameType | None) -> None:
    if _entered and not _entered[-1].received:
        _entered[-1].received = number
        _entered[-1].stop()
    else:
        _handlers[number](number, frame)
