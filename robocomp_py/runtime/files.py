"""What a component leaves open when it ends."""

from __future__ import annotations

import gc
import io
import logging
import os
import stat

log = logging.getLogger("robocomp.worker")

_BUFFERED = (io.TextIOWrapper, io.BufferedWriter, io.BufferedRandom)


def write_out() -> None:
    """Write what is still in the memory of files that nobody has closed.

    A worker belongs to cycles of references, and of a text file that goes with such a cycle Python loses what has not
    been written yet. What was there before `gc.freeze` is not looked at.
    """
    for each in gc.get_objects():
        if issubclass(type(each), _BUFFERED) and _is_of_a_disk(each):
            try:
                each.flush()
            except (OSError, ValueError) as exc:
                log.warning("what is left of %r could not be written: %s", getattr(each, "name", "a file"), exc)


def _is_of_a_disk(file: io.IOBase) -> bool:
    """Whether writing cannot wait for somebody who reads."""
    try:
        return file.writable() and stat.S_ISREG(os.fstat(file.fileno()).st_mode)
    except (OSError, ValueError):  # it is closed, or none of the system's
        return False
