"""What transports take from Linux and from CPython that the standard library does not offer.

what                  written for            if the probe fails
watch, add_watch      Linux, any C library   OSError: the caller looks from time to time
end_with_parent       Linux, any C library   nothing is set: a child may outlive the thread that started it
keep_thread_state     CPython 3.11 to 3.13   Python makes the thread's state again at each callback (25 µs)
release_thread_state  CPython 3.11 to 3.13   nothing is released, as nothing was kept
keep                  CPython 3.11 to 3.13   the object may be finalized at the end of the program
"""

from __future__ import annotations

import ctypes
import errno
import os
import signal
from typing import Any

_PR_SET_PDEATHSIG = 1

_LOCKED = 0
"""PyGILState_LOCKED: the calling thread already holds the global lock, and keeps it."""

_library = ctypes.CDLL(None, use_errno=True)
_inotify_init1: Any = getattr(_library, "inotify_init1", None)
_inotify_add_watch: Any = getattr(_library, "inotify_add_watch", None)
_prctl: Any = getattr(ctypes.PyDLL(None), "prctl", None)
_ensure: Any = getattr(ctypes.pythonapi, "PyGILState_Ensure", None)
_release: Any = getattr(ctypes.pythonapi, "PyGILState_Release", None)
_inc_ref: Any = getattr(ctypes.pythonapi, "Py_IncRef", None)


def watch() -> int:
    """A descriptor that has input when a watched folder changes. Raises OSError, as when there are too many."""
    if _inotify_init1 is None or _inotify_add_watch is None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
    return _checked(_inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC))


def add_watch(descriptor: int, folder: str, events: int) -> int:
    """Watch a folder; returns its number in the input. Raises OSError."""
    return _checked(_inotify_add_watch(descriptor, os.fsencode(folder), events))


def _checked(number: int) -> int:
    if number < 0:
        why = ctypes.get_errno()
        raise OSError(why, os.strerror(why))
    return number


def end_with_parent() -> None:
    """Have the kernel end this process when the thread that forked it ends."""
    if _prctl:
        _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def keep_thread_state() -> None:
    """Have Python keep the state of this thread, which a library has started, from one callback to the next.

    The state stays until the thread releases it. Without that, it stays as long as the process.
    """
    if _ensure and _release:
        _ensure()


def release_thread_state() -> None:
    """To be called at the end of a thread that has kept its state."""
    if _ensure and _release:
        _release(_LOCKED)


def keep(value: object) -> None:
    """Keep an object as long as the process, so that its destructor does not run, not even at the end."""
    if _inc_ref:
        _inc_ref(ctypes.py_object(value))
