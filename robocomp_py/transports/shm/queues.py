"""Requests, commands and replies, in queues that one transport reads and others write to.

Every transport has a queue under its name. A thread that waits for a reply has a line: a queue with a wake-up pipe,
which only that thread reads.
"""

from __future__ import annotations

import itertools

from ...errors import TransportError
from ...wire.codec import Payload
from .node import PORTS, Node
from .receipts import Reader as Receiver
from .room import Full
from .samples import Reader, Writer
from .wakeup import NUDGE, QUEUED, Waker, Wakeup, wakeup_path

WAITING = 128
"""Maximum number of messages of one sender in the queue of a transport."""

ANSWERS = 4
"""Maximum number of replies in a line: the awaited one, and some late ones."""

KEPT = 16
"""Maximum number of messages of a queue or line that may be kept without a copy."""

_LOANS = 16
"""Maximum number of messages to one queue that are written at the same time."""

CONFIRM = 0xFFFFFFFF
"""The address of a message that only asks for a reply, which confirms that all earlier messages were taken."""

WAKE_EARLY = 1 << 31
"""Added to the number of a line: wake the client already when the reply is about to be written."""

LINGER = 1.5
"""Seconds for which closing waits until the last messages are taken."""

AHEAD = WAITING
"""Maximum number of unopened messages of one sender at a transport. The transport reads the messages of all senders
before it opens the next one, so that no sender waits behind the others; this bounds what it has read."""

FEW_AHEAD, BYTES_AHEAD = 4, 8 * 1024 * 1024
"""The same for large messages: a minimum number of them, and a maximum of bytes beyond it."""

_SMALL = BYTES_AHEAD // AHEAD

_LONGEST_PAUSE = 0.005
"""Seconds between two attempts to send, when there is no room."""


def packed(member_id: str) -> int:
    """The name of a member of the directory, `<pid>-<eight hexadecimal digits>`, as a number."""
    pid, _, rest = member_id.partition("-")
    return int(pid) << 32 | int(rest, 16)


def unpacked(member: int) -> str:
    return f"{member >> 32}-{member & 0xFFFFFFFF:08x}"


def queue_of(member_id: str, line: int) -> str:
    """The name of a queue; line 0 is the queue of the transport."""
    return f"{member_id}/{line}" if line else member_id


class InputQueue:
    """The queue of this transport, which all peers write to. Its wake-up pipe is that of the transport."""

    def __init__(self, node: Node, member_id: str) -> None:
        queue = node.new_queue(queue_of(member_id, 0), WAITING, KEPT + 1, PORTS, lossy=False)
        self._node, self._name = node, queue_of(member_id, 0)
        self._reader = Reader(queue, KEPT, node.heaps)
        self.read = self._reader.read
        self.close = self._reader.close

    def reconnect(self) -> None:
        """Have the library connect to senders to which it could not connect when they came.

        The library does not report such a failure, and tries again only when another sender comes, so this opens one.
        """
        self._node.queue(self._name, 1)


class ReplyQueue:
    """A queue for the answers to one thread."""

    def __init__(self, node: Node, member_id: str, number: int) -> None:
        self.number = number
        queue = node.new_queue(queue_of(member_id, number), ANSWERS, KEPT + 1, 2, lossy=True)
        self._reader = Reader(queue, KEPT, node.heaps)
        self._wakeup = Wakeup(wakeup_path(node.folder, member_id, number))
        self.read, self.woken = self._reader.read, self._wakeup.woken

    def close(self) -> None:
        self._reader.close()
        self._wakeup.close()


class Sender:
    """Sends messages to one queue, from any thread."""

    def __init__(self, node: Node, own: int, member_id: str, line: int, opened: Receiver | None = None) -> None:
        """`opened` tells how many messages the reader has opened, if the number of unopened ones is limited."""
        self._own = own
        self._closed = False
        self._receiver = opened
        self._opened_before = opened.taken() if opened else 0
        self._numbers = itertools.count(1)
        self._sent = self._opened = 0
        """The number of messages sent, and of those opened at the last look."""
        self.hindrance = ""
        """Why sending failed for lack of memory; "" if it never did."""
        self._waker = Waker(wakeup_path(node.folder, member_id, line))
        self._writer = Writer(node.queue(queue_of(member_id, line), _LOANS), node.heap)

    def send(self, line: int, to: int, header: bytes, payload: Payload, size: int) -> bool:
        """Send; False if there is no room now, or the reader has gone."""
        if self._receiver and self._is_too_far_ahead(size):
            return False
        try:
            if not self._writer.send(self._own, line, to, header, payload, size):
                return False
        except Full as exc:
            self.hindrance = f": {exc}"
            if self._writer.waits:  # memory becomes free when readers take earlier messages
                return False
            raise
        except TransportError:
            if self._closed:  # meanwhile, since the reader has gone
                return False
            raise
        self._sent = next(self._numbers)
        self._waker.wake(QUEUED)
        return True

    def _is_too_far_ahead(self, size: int) -> bool:
        ahead = AHEAD if size < _SMALL else max(FEW_AHEAD, BYTES_AHEAD // size)
        if self._sent - self._opened < ahead:
            return False
        assert self._receiver
        self._opened = self._receiver.taken() - self._opened_before
        return self._sent - self._opened >= ahead

    def announce(self) -> None:
        """Wake the reader early: a message is about to be sent."""
        self._waker.wake(NUDGE)

    def close(self) -> None:
        self._closed = True
        self._writer.close()
        self._waker.close()
