"""What workers of RoboComp take from CPython that it does not offer.

    what                  written for            if the probe fails
    before_threads        CPython 3.11 to 3.13   called later: once all threads have ended that Python waits for
    not_awaited           CPython 3.11 to 3.13   Python waits for the thread at the end, however long it runs
    exits_noted           any Python             `sys.exit` can always be replaced, and is not documented to be

Standard library only.
"""

from __future__ import annotations

import atexit
import concurrent.futures.thread
import contextlib
import sys
import threading
from collections.abc import Callable, Iterator, MutableMapping
from typing import Any

_register: Callable[[Callable[[], None]], None] | None = getattr(threading, "_register_atexit", None)
_awaited: MutableMapping[threading.Thread, Any] | None = getattr(concurrent.futures.thread, "_threads_queues", None)


def before_threads(call: Callable[[], None]) -> None:
    """Have Python call this when the main thread has ended, before it waits for other threads."""
    if _register:
        _register(call)
    else:
        atexit.register(call)


def not_awaited(thread: threading.Thread) -> None:
    """Have Python not wait for this thread of a pool when the process ends."""
    if _awaited is not None:
        _awaited.pop(thread, None)


@contextlib.contextmanager
def exits_noted(note: Callable[[Any], None]) -> Iterator[None]:
    """Within this, `sys.exit` calls `note` with its argument first."""
    before = sys.exit

    def noted(status: Any = None, /) -> Any:
        note(status)
        before(status)

    sys.exit = noted
    try:
        yield
    finally:
        sys.exit = before
