"""Where the commands begin. Ctrl-C ends one quietly also while it is imported."""

from __future__ import annotations

import os
import signal
from importlib import import_module
from types import FrameType

_INTERRUPTED = 130


def rc() -> int:
    return _run("rc")


def rcdeploy() -> int:
    return _run("rcdeploy")


def rcgen() -> int:
    return _run("rcgen")


def _run(name: str) -> int:
    """Import a command, and run it.

    While it is imported, Ctrl-C ends the process instead of raising KeyboardInterrupt, which imported code might catch.
    """
    is_interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_interruptible:
        signal.signal(signal.SIGINT, _end)
    main = import_module(f".{name}", __package__).main
    try:
        if is_interruptible:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        return int(main())
    except KeyboardInterrupt:
        return _INTERRUPTED


def _end(number: int, frame: FrameType | None) -> None:
    os._exit(_INTERRUPTED)  # nothing has begun that would have to be cleaned up
