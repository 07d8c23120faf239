"""Programs that keep a Unix socket busy."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections import deque
from collections.abc import Iterator
from pathlib import Path

from robocomp_py.deploy.sockets import connected


@contextlib.contextmanager
def crowded(path: Path, most: int, says: bytes = b"", timeout: float = 1.0) -> Iterator[None]:
    """While this is entered, two threads connect as fast as they can, and keep up to `most` connections each."""
    ending = threading.Event()

    def connect() -> None:
        kept = deque[socket.socket]()
        while not ending.is_set():
            with contextlib.suppress(OSError):
                kept.append(connected(path, timeout))
                kept[-1].sendall(says)
            if len(kept) > most:
                kept.popleft().close()
        for each in kept:
            each.close()

    loops = [threading.Thread(target=connect) for _ in range(2)]
    for each in loops:
        each.start()
    try:
        yield
    finally:
        ending.set()
        for each in loops:
            each.join()
