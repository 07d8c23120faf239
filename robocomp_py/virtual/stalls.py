"""Finds code that waits for the machine while virtual time stands still, as `time.sleep` does.

A look from time to time is enough: what takes much of the run is soon found. A thread that waits is told from one that
computes, or that gets no processor, by the system: it sleeps at two looks, and has not run in between.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType

_PAUSE = 0.05
"""Seconds between two looks at a thread that runs."""

_AGAIN = 0.005
"""Seconds until the next look at one that sleeps."""

_STAND = re.compile(rb"^State:\s*[SD] .*^(voluntary_ctxt_switches:.*)", re.MULTILINE | re.DOTALL)
"""Matches only a thread that sleeps, and takes the number of times that it gave up the processor."""

_PACKAGE = Path(__file__).parent.parent


class Stalls:
    def __init__(self, tell: Callable[[threading.Thread, FrameType], object]) -> None:
        """`tell` gets a thread that waits, and its innermost frame."""
        self._tell = tell
        self._stand: tuple[int | None, bytes] | None = None
        """Of the latest look; None if the thread did not sleep."""

    def look(self, thread: threading.Thread) -> float:
        """Look at the thread that runs events. Returns the seconds until the next look."""
        before, self._stand = self._stand, _stand(thread.native_id)
        if self._stand is None or self._stand != before:
            return _PAUSE if self._stand is None else _AGAIN
        if thread.ident and (frame := sys._current_frames().get(thread.ident)):
            self._tell(thread, frame)
        return _PAUSE


def folder_of(worker: type) -> Path | None:
    """The folder of the module that defines a class."""
    file = getattr(sys.modules.get(worker.__module__), "__file__", None)
    return Path(file).parent if file else None


def line_in(folder: Path | None, frame: FrameType | None) -> tuple[str, int] | None:
    """The file and the line, within a folder, from which a frame was called.

    None if that was in no such file, or if this package waits there.
    """
    while folder and frame:
        path = Path(frame.f_code.co_filename)
        if path.is_relative_to(_PACKAGE):
            return None
        if path.is_relative_to(folder) and "site-packages" not in path.parts:
            return str(path), frame.f_lineno
        frame = frame.f_back
    return None


def _stand(thread: int | None) -> tuple[int | None, bytes] | None:
    try:
        found = _STAND.search(Path(f"/proc/self/task/{thread}/status").read_bytes())
    except OSError:  # the thread has ended, or the system has no such files
        return None
    return (thread, found[1]) if found else None
