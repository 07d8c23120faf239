"""Programs that speak ZeroMQ's protocol over TCP without its library, and try to take more than their share."""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import resource
import socket
import threading
import time
from collections.abc import Callable, Iterator

GREETING = b"\xff\0\0\0\0\0\0\0\1\x7f\3\0NULL".ljust(64, b"\0")
MEBIBYTE = 1024 * 1024
PART_OF_A_MESSAGE = b"\3" + MEBIBYTE.to_bytes(8, "big") + bytes(MEBIBYTE)
"""A frame that says that more of its message follow."""

_SILENT = 3000
"""Connections that say nothing."""

_STUCK = 30.0


def ready(kind: bytes, identity: bytes = b"") -> bytes:
    """What ends the handshake of a socket of that kind."""
    properties = {b"Socket-Type": kind, b"Identity": identity}
    body = b"\5READY" + b"".join(
        bytes([len(name)]) + name + len(value).to_bytes(4, "big") + value for name, value in properties.items()
    )
    return bytes([4, len(body)]) + body


def connection(port: int, kind: bytes = b"DEALER", identity: bytes = b"") -> socket.socket:
    """A connection to this host that has done its part of the handshake."""
    opened = socket.create_connection(("127.0.0.1", port), _STUCK)
    with contextlib.suppress(ConnectionError):  # it was closed at once, which is seen when something is sent
        opened.sendall(GREETING + ready(kind, identity))
    return opened


def subscriptions(count: int = 500) -> bytes:
    """So many subscriptions, each to something else."""
    return b"".join(b"\0\x3d\1" + os.urandom(60) for _ in range(count))


def pour(opened: socket.socket, part: Callable[[], bytes], most: int, until: float = math.inf) -> tuple[int, bool]:
    """Send until the other side closes the connection, at most so many octets; how many, and whether it did.

    It ends at the monotonic time `until`, too.
    """
    sent = 0
    try:
        while sent < most and time.monotonic() < until:
            octets = part()
            opened.sendall(octets)
            sent += len(octets)
    except (ConnectionError, TimeoutError):
        return sent, True
    return sent, False


def attack(what: str, port: int, seconds: float, request: bytes = b"") -> dict[str, int]:
    """Do one of these things to a port of this host for so many seconds; how much was sent and how often it ended.

    `request` is how a request begins whose payload is missing.
    """
    end = time.monotonic() + seconds
    if what == "bombs":
        return _send_bombs(port, request, end)
    if what == "silent":
        return _be_silent(port, end)
    kind, part = (b"XSUB", subscriptions) if what == "subscriptions" else (b"DEALER", lambda: PART_OF_A_MESSAGE)
    total = closed = 0
    last = end + _STUCK
    while time.monotonic() < (end if closed else last):  # on a slow machine it takes longer to exceed a bound
        with contextlib.closing(connection(port, kind)) as opened:
            opened_until = end if closed else last
            opened.settimeout(max(0.1, opened_until - time.monotonic()))
            sent, was_closed = pour(opened, part, 8 * 1024 * MEBIBYTE, opened_until)
        total += sent
        closed += was_closed
    return {"sent": total, "closed": closed}


@contextlib.contextmanager
def flood(port: int) -> Iterator[None]:
    """Subscribe to more and more, again and again."""
    over = threading.Event()
    octets = subscriptions()

    def work() -> None:
        while not over.is_set():
            with contextlib.suppress(OSError), contextlib.closing(connection(port, b"XSUB")) as opened:
                while not over.is_set():
                    opened.sendall(octets)

    threads = [threading.Thread(target=work, name="stranger") for _ in range(2)]
    for each in threads:
        each.start()
    try:
        yield
    finally:
        over.set()
        for each in threads:
            each.join(_STUCK)


def _send_bombs(port: int, request: bytes, end: float) -> dict[str, int]:
    """Send six requests at a time whose payloads are small for what they would become as objects."""
    sent = 0
    payloads = itertools.cycle(bombs())
    with contextlib.closing(connection(port)) as opened:
        while time.monotonic() < end:
            for _ in range(6):
                message = request + next(payloads)
                opened.sendall(b"\2" + len(message).to_bytes(8, "big") + message)
                sent += 1
            threading.Event().wait(0.2)
    return {"sent": sent, "closed": 0}


def bombs() -> Iterator[bytes]:
    """Payloads of MessagePack, as large as they may be."""
    count = 16 * MEBIBYTE - 100
    for tiny in (b"\x80", b"\x90", b"\xa0", b"\x81\xa0\xc0"):
        yield b"\x91\xdd" + (count // len(tiny)).to_bytes(4, "big") + tiny * (count // len(tiny))
    yield b"\x91" * count


def _be_silent(port: int, end: float) -> dict[str, int]:
    """Open `_SILENT` connections and say nothing."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, max(soft, _SILENT + 200)), hard))
    with contextlib.ExitStack() as opened:
        for _ in range(_SILENT):
            each = opened.enter_context(socket.socket())
            each.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                each.connect(("127.0.0.1", port))
        threading.Event().wait(max(0.0, end - time.monotonic()))
    return {"sent": 0, "closed": _SILENT}


@contextlib.contextmanager
def server(answer: Callable[[socket.socket], object]) -> Iterator[int]:
    """Something that listens; `answer` is called with its first connection, on a thread. Yields its port."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(_STUCK)

        def serve() -> None:
            with contextlib.suppress(OSError), listening.accept()[0] as opened:
                opened.settimeout(_STUCK)
                answer(opened)

        thread = threading.Thread(target=serve, name="stranger")
        thread.start()
        try:
            yield listening.getsockname()[1]
        finally:
            listening.close()
            thread.join(_STUCK)
