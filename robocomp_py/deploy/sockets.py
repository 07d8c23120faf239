"""Sockets in the run-time folder, however long its path is."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

from ..transports.directory import LONGEST_SOCKET


@contextlib.contextmanager
def address(path: Path) -> Iterator[str]:
    """How to call a socket of this path."""
    if len(os.fsencode(path)) <= LONGEST_SOCKET:
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
        made.listen(128)  # at most this many clients wait for their turn
    except OSError:
        made.close()
        raise
    return made


def connected(path: Path, timeout_s: float) -> socket.socket:
    """A connection to the server there. Raises TimeoutError if its queue stays full, OSError if nothing listens."""
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
    try:
        # With a time-out of Python's, the socket does not block: the kernel would refuse a full queue at once, and
        # blocking clients would take the place of one that tries again later. So the kernel does the waiting.
        microseconds = max(int(timeout_s * 1e6), 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", *divmod(microseconds, 1_000_000)))
        with address(path) as name:
            made.connect(name)
        made.settimeout(timeout_s)
    except BlockingIOError as exc:
        made.close()
        raise TimeoutError(exc.errno, "too many clients wait there") from exc
    except OSError:
        made.close()
        raise
    return made
