"""Ends a process that was asked to stop and does not, as rcdeploy would if it had started the process.

A thread of faulthandler ends it, because that thread needs no lock of Python: stuck code may hold any of them.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import sys
import threading
from collections.abc import Sequence

from .notify import is_launched

STUCK = 2.0
"""Seconds from the request to stop until a message says what the component is still doing."""

GRACE = 5.0
"""Seconds that each component of a process has to stop."""


_armed: list[float] = []
"""The seconds until the forced end of this process, once it is scheduled.

No `threading.Event`: a signal handler that sets one waits for ever if its thread was just setting it.
"""


def grace_of(asked: Sequence[float | None]) -> float | None:
    """Seconds that the process has to stop, given the `--grace` of each component; None if its launcher ends it.

    rcdeploy, systemd and containers end a process that does not stop, each after a time of its own.
    """
    if not any(each is not None for each in asked) and is_launched():
        return None
    return sum(GRACE if each is None else each for each in asked)


def end_after(seconds: float | None) -> None:
    """Unless the process ends earlier, print the stacks of its threads after that time, and exit with code 1.

    Only the first call has an effect. May be called from any thread, and from a signal handler.
    """
    if seconds is None or _armed:
        return
    _armed.append(seconds)
    try:
        faulthandler.dump_traceback_later(seconds, exit=True, file=_complaints())
    except RuntimeError:  # the system cannot start another thread; the component is asked to stop anyway
        _armed.clear()


def _complaints() -> int:
    for stream in (sys.stderr, sys.__stderr__):
        with contextlib.suppress(ValueError, OSError, AttributeError):  # it is closed, or not a file
            return stream.fileno()  # type: ignore[union-attr]  # None without a console: an AttributeError
    return os.open(os.devnull, os.O_WRONLY)


def settle() -> None:
    """Cancel the forced end: the components have ended. Unless threads of user code still keep the process alive."""
    others = [each for each in threading.enumerate() if each is not threading.current_thread() and not each.daemon]
    if _armed and not others:
        faulthandler.cancel_dump_traceback_later()
        _armed.clear()


def announced(grace: float | None) -> str:
    """The end of the message about a stuck component: how it can be ended, and when it will be."""
    left = f", otherwise it is ended in {grace - STUCK:g} s" if grace is not None and grace > STUCK else ""
    return f"; press Ctrl-C again to end it now{left}"
