"""Files that a component leaves open when it ends."""

from __future__ import annotations

import gc
import io
import logging
import os
import stat

log = logging.getLogger("robocomp.worker")

_BUFFERED = (io.TextIOWrapper, io.BufferedWriter, io.BufferedRandom)


def write_out() -> None:
    """Flush all files that were left open.

    A worker is part of a reference cycle. When the garbage collector removes a text file with such a cycle, Python
    loses its buffered text. Objects older than `gc.freeze` are not searched.
    """
    for each in gc.get_objects():
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
