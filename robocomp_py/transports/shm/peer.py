"""A server process, as the links of its clients use it."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from ...errors import Unreachable
from ...wire.header import Flag, pack_request, random_id, reply_at
from ..directory import Directory
from ..link import persist
from ..members import Member
from .node import Node
from .queues import CONFIRM, ReplyQueue, Sender, packed
from .receipts import Reader as Receiver
from .samples import HEAD_BYTES


class Peer:
    """A server process: its queue for requests, and lines for blocking calls to it.

    A line is a queue for replies that one thread uses at a time. It has a number, and is kept for later calls.
    """

    def __init__(
        self,
        member: Member,
        own: int,
        node: Node,
        directory: Directory,
        receipts: Path,
        new_line: Callable[[], ReplyQueue],
    ) -> None:
        """`own` is the key of this process. `receipts` is the file in which the server shows what it has opened."""
        self.id, self.key = member.id, packed(member.id)
        self.closed = False
        self.unsettled = False
        """Whether a command was sent that may not have been taken yet."""
        self._directory, self._new_line = directory, new_line
        self._idle: list[ReplyQueue] = []
        self._stale = 0
        """The number of the last line that is used no more."""
        self.sender = Sender(node, own, member.id, 0, Receiver(receipts, own, 0))
        node.heaps.meet(self.key)  # so that its last replies can still be read after it has left

    def alive(self) -> bool:
        return not self.closed and self._directory.alive(self.id)

    def take(self, asking: str) -> ReplyQueue:
        """A line for the calling thread alone, and what it is asking for; the thread must `give` it back."""
        if self.closed:
            raise Unreachable(f"{asking}: its server left")
        if self._idle:
            try:
                return self._idle.pop()
            except IndexError:  # another thread has taken it
                pass
        return self._new_line()

    def settle(self, end: float) -> None:
        """Wait until all commands were taken, at most until `end` (monotonic): closing discards unread ones."""
        if not self.unsettled or not self.alive():
            return
        line = self.take(self.id)
        try:
            number = random_id()
            header = pack_request(Flag.NONE, 0, 0, number, max(0.0, end - time.monotonic()))
            confirm = partial(self.sender.send, line.number, CONFIRM, header, b"", 0)
            if not persist(confirm, end, lambda: None, threading.Event()):
                return
            while time.monotonic() < end and self.alive():
                line.woken(end - time.monotonic())
                while (message := line.read()) is not None:
                    if reply_at(message.octets, HEAD_BYTES).sequence == number:
                        return
        finally:
            self.give(line)

    def give(self, line: ReplyQueue) -> None:
        self._idle.append(line)
        if self.closed or line.number <= self._stale:  # checked last: `close` and `renew` set these first
            self._close_idle()

    def renew(self, last: int) -> None:
        """Use no line up to the number `last` any more, since servers may be unable to reach them."""
        self._stale = last
        self._close_idle()

    def close(self) -> None:
        self.closed = True
        self._close_idle()
        self.sender.close()

    def _close_idle(self) -> None:
        """Close idle lines one by one, since other threads may add or take some meanwhile."""
        with contextlib.suppress(IndexError):
            while True:
                self._idle.pop().close()
