"""Letters: requests, commands and replies, in queues that one transport reads and others write to.

Every transport has a queue under its name, for all that nobody in particular expects. A thread that waits for an
answer has a line of its own: a queue, with a bell, that nobody else reads.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from ...errors import TransportError
from ...wire.codec import Payload
from .bells import MAIL, SOON, Bell, Rope, bell_path
from .node import PORTS, Node
from .samples import Reader, Writer

WAITING = 128
"""Letters of one sender that may wait in the queue of a transport."""

ANSWERS = 4
"""Answers that may wait in a line: one that is waited for, and some that came too late for others."""

KEPT = 16
"""Letters that may be kept without being copied: of each queue, and each line."""

_LOANS = 16
"""Letters to one queue that may be written at the same time."""

KNOCK = 0xFFFFFFFF
"""Whom a letter is for that wants nothing but an answer, which tells that all before it were taken."""

HURRY = 1 << 31
"""Added to the number of a line: to be rung already when the answer is about to be written."""

LINGER = 1.5
"""Seconds for which closing waits for what was sent last to be taken."""

_LONGEST_PAUSE = 0.005
"""Seconds between two attempts to send, when there is no room."""


def packed(member_id: str) -> int:
    """The name of a member of the directory, `<pid>-<eight hexadecimal digits>`, as a number."""
    pid, _, rest = member_id.partition("-")
    return int(pid) << 32 | int(rest, 16)


def unpacked(member: int) -> str:
    return f"{member >> 32}-{member & 0xFFFFFFFF:08x}"


def queue_of(member_id: str, line: int) -> str:
    """The name of a queue; line 0 is for everybody."""
    return f"{member_id}/{line}" if line else member_id


class Mailbox:
    """The queue that everybody writes to. Its bell is the one that wakes the transport."""

    def __init__(self, node: Node, member_id: str) -> None:
        self._reader = Reader(node.new_queue(queue_of(member_id, 0), WAITING, KEPT + 1, PORTS, lossy=False), KEPT)
        self.read = self._reader.read
        self.close = self._reader.close


class Line:
    """A queue for the answers to one thread."""

    def __init__(self, node: Node, member_id: str, number: int) -> None:
        self.number = number
        self._reader = Reader(node.new_queue(queue_of(member_id, number), ANSWERS, KEPT + 1, 2, lossy=True), KEPT)
        self._bell = Bell(bell_path(node.folder, member_id, number))
        self.read, self.rung = self._reader.read, self._bell.rung

    def close(self) -> None:
        self._reader.close()
        self._bell.close()


class Post:
    """By which letters are sent to one queue, from any thread."""

    def __init__(self, node: Node, own: int, member_id: str, line: int) -> None:
        self._own = own
        self._closed = False
        self._rope = Rope(bell_path(node.folder, member_id, line))
        self._writer = Writer(node.queue(queue_of(member_id, line), _LOANS))

    def send(self, line: int, to: int, header: bytes, payload: Payload, size: int) -> bool:
        """Whether it was sent; if not, there is no room now, or nobody reads there any more."""
        try:
            if not self._writer.send(self._own, line, to, header, payload, size):
                return False
        except TransportError:
            if self._closed:  # meanwhile, since nobody reads there any more
                return False
            raise
        self._rope.ring(MAIL)
        return True

    def announce(self) -> None:
        """Wake who will read what is about to be sent."""
        self._rope.ring(SOON)

    def close(self) -> None:
        self._closed = True
        self._writer.close()
        self._rope.close()


def persist(send: Callable[[], bool], end: float, still: Callable[[], object], closed: threading.Event) -> bool:
    """Try to send until `end`; `still` is called meanwhile, and may raise."""
    pause = 0.0001
    while not send():
        left = end - time.monotonic()
        if left <= 0:
            return False
        still()
        closed.wait(min(pause, left))
        pause = min(2 * pause, _LONGEST_PAUSE)
    return True
