"""What the end of a component takes from CPython that other Pythons need not offer.

    what        written for            if the probe fails
    write_out   CPython 3.11 to 3.13   the end of a file that a worker left open may be lost

Standard library only.
"""

from __future__ import annotations

import gc
import io
import logging
import os
import stat
from collections.abc import Callable
from typing import Any

log = logging.getLogger("robocomp.worker")

_all_objects: Callable[[], list[Any]] | None = getattr(gc, "get_objects", None)

_BUFFERED = (io.TextIOWrapper, io.BufferedWriter, io.BufferedRandom)


def write_out() -> None:
    """Flush all files that a component left open when it ended.

    A worker is part of a reference cycle. When the garbage collector removes a text file with such a cycle, Python
    loses its buffered text. Objects older than `gc.freeze` are not searched.
    """
    for each in _all_objects() if _all_objects else ():
        if issubclass(type(each), _BUFFERED) and _is_of_a_disk(each):
            try:
                each.flush()
            except (OSError, ValueError) as exc:
                log.warning("the rest of %r could not be written: %s", getattr(each, "name", "a file"), exc)


def _is_of_a_disk(file: io.IOBase) -> bool:
    """Whether it is a regular file, so that a flush cannot block until a reader reads."""
    try:
        return file.writable() and stat.S_ISREG(os.fstat(file.fileno()).st_mode)
    except (OSError, ValueError):  # it is closed, or has no descriptor
        return False
