"""Ends a process that was asked to stop and does not, as rcdeploy would if it had started the process.

The thread that ends it is faulthandler's own and needs no lock of Python's, which code that is stuck may hold.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import sys
import threading
from collections.abc import Sequence

from .notify import READY_FILE

STUCK = 2.0
"""Seconds after being asked to stop until people are told what a component still does."""

GRACE = 5.0
"""Seconds that each component of a process has for its end."""


_armed = threading.Event()
"""Whether the end of this process has been arranged."""


def grace_of(asked: Sequence[float | None]) -> float | None:
    """Seconds that a process of components with these wishes (`--grace`) has to stop; None if its launcher sees to it.

    rcdeploy, systemd and containers end what does not stop, each within a time of their own.
    """
    if not any(each is not None for each in asked) and ("NOTIFY_SOCKET" in os.environ or READY_FILE in os.environ):
        return None
    return sum(GRACE if each is None else each for each in asked)


def end_after(seconds: float | None) -> None:
    """Have this process print where its threads are, and end with exit code 1, unless it has ended before.

    The first call counts. May be called from any thread, and from a handler of signals.
    """
    if seconds is None or _armed.is_set():
        return
    _armed.set()
    try:
        faulthandler.dump_traceback_later(seconds, exit=True, file=_complaints())
    except RuntimeError:  # the system has no thread to spare for it; the component is asked to stop all the same
        _armed.clear()


def _complaints() -> int:
    for stream in (sys.stderr, sys.__stderr__):
        with contextlib.suppress(ValueError, OSError, AttributeError):  # it is closed, or not a file
            return stream.fileno()  # type: ignore[union-attr]  # None without a console: an AttributeError
    return os.open(os.devnull, os.O_WRONLY)


def settle() -> None:
    """The components have ended. Only threads that their code left behind could still keep the process."""
    others = [each for each in threading.enumerate() if each is not threading.current_thread() and not each.daemon]
    if _armed.is_set() and not others:
        faulthandler.cancel_dump_traceback_later()
        _armed.clear()


def announced(grace: float | None) -> str:
    """What happens to a component that is stuck: the end of a sentence that says what it is busy with."""
    left = f"; it is ended in {grace - STUCK:g} s" if grace is not None and grace > STUCK else ""
    return f"; Ctrl-C again ends it now{left}"
