"""Sockets in the run-time folder, however long its path is."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path

_LONGEST = 107
"""Bytes of a path that the kernel takes for a socket."""


@contextlib.contextmanager
def address(path: Path) -> Iterator[str]:
    """How to call a socket of this path."""
    if len(os.fsencode(path)) <= _LONGEST:
        yield str(path)
        return
    folder = os.open(path.parent, os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)


def listening(path: Path) -> socket.socket:
    """A socket at this path, in the place of one that a killed process left. Raises OSError."""
    path.unlink(missing_ok=True)
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
    try:
        with address(path) as name:
            made.bind(name)
        made.listen(16)
    except OSError:
        made.close()
        raise
    return made


def connected(path: Path, patience_s: float) -> socket.socket:
    """To who listens there. Raises OSError if nobody does."""
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
    made.settimeout(patience_s)
    try:
        with address(path) as name:
            made.connect(name)
    except OSError:
        made.close()
        raise
    return made
