"""Opens messages, passes them to their links, and sends the replies."""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import Closed, DecodeError, TransportError
from ...wire.header import NO_DEADLINE, Request, pack_reply, reply_at, request_at
from ..base import Reply, Status
from ..directory import Directory
from ..leader_followers import Job
from ..link import persist
from ..server import dispatch
from ..sparing import Sparing
from ..turns import Turns
from .node import Node
from .queues import CONFIRM, WAKE_EARLY, InputQueue, Sender, packed, unpacked
from .receipts import Receipts
from .samples import HEAD_BYTES, Message, size_of

if TYPE_CHECKING:
    from ..client import CallingLink
    from ..server import ServingLink

log = logging.getLogger("robocomp.transport.shm")

INSISTING = 5.0
"""Seconds for which a reply waits for room, if its request has no deadline."""


ALONE = 16
"""Messages in a row of the only known sender after which other senders are looked for."""

NOTED = 16
"""Opened messages after which their sender is told; sooner if no more are waiting."""

MOST = 4096
"""Maximum number of messages that are read and wait to be opened."""


class Dispatcher:
    """`open_next` is for one thread at a time; replies may come from any."""

    def __init__(
        self,
        queue: InputQueue,
        node: Node,
        directory: Directory,
        own: int,
        incarnation: int,
        receipts: Path,
        do: Callable[[Job], object],
    ) -> None:
        """`own` is the key of this process, and `receipts` the file in which it shows what it has opened. `do` runs a
        job on a thread that receives."""
        self._queue, self._node, self._directory = queue, node, directory
        self._own, self._incarnation, self._receipts_file, self._do = own, incarnation, receipts, do
        self.serving: dict[int, ServingLink] = {}
        """By the number in messages to them."""
        self.callers: dict[int, CallingLink[Any, Any, Any]] = {}
        """By the client in replies to them."""
        self._turns: Turns[tuple[float, Message]] = Turns()
        """Messages that were read but not opened, and when they were read."""
        self._in_a_row = 0
        """The number of messages since the queue was last empty."""
        self._receipts: Receipts | None = None
        """The file in which senders see how many of their messages were opened."""
        self._opened: dict[int, int] = {}
        """That number, by sender."""
        self._noted: set[int] = set()
        """Senders with a slot in that file."""
        self._unnoted: set[int] = set()
        """Senders whose slot is not up to date."""
        self._senders: dict[tuple[int, int], Sender] = {}
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._sparing = Sparing()
        self._told = False
        """Whether a malformed message was logged."""

    def serve(self, number: int, link: ServingLink) -> None:
        """Pass messages with that number to that link."""
        with self._lock, contextlib.suppress(TransportError):  # tried again at the first message
            self._open_receipts()  # now, since the disk may be full later
        self.serving[number] = link

    def open_next(self) -> Job | None:
        """The job for the next message; None if there is none."""
        if self._turns:
            self._read_all()  # first, so that a new sender gets its turn before older requests of others
            read_at, message = self._turns.take()
        else:
            found = self._queue.read()
            if found is None:
                self._in_a_row = 0
                self.note()
                return None
            read_at, message = time.monotonic(), found
            self._in_a_row += 1
            if len(self._opened) > 1 or self._in_a_row > ALONE:
                self._turns.add(_turn(message), (read_at, message))
                self._read_all()
                read_at, message = self._turns.take()
        try:
            if not message.to:
                return self._forward(message) or _nothing
            self._count(message.member)
            return self._accept(message, read_at) or _nothing
        except DecodeError as exc:
            self._malformed(message, exc)
            return _nothing

    def reply(self, member: int, line: int, request: Request, expires: float, reply: Reply) -> None:
        try:
            sender = self._senders.get((member, line)) or self._new_sender(member, line)
            if sender is None:
                return  # the client has gone
            payload = b"" if reply.payload is None else reply.payload
            header = pack_reply(reply.status, request.client, request.sequence, self._incarnation)
            size = size_of(payload)
            if not sender.send(0, 0, header, payload, size):
                send = partial(sender.send, 0, 0, header, payload, size)
                self._do(partial(self._insist, send, member, min(expires, time.monotonic() + INSISTING)))
        except TransportError as exc:
            if self._sparing.may_tell():
                log.error("a reply could not be sent: %s", exc)
            if reply.status is not Status.FAILED and not self._closed.is_set():
                self.reply(member, line, request, expires, Reply(Status.FAILED))

    def drop(self, member_id: str) -> None:
        """That member has gone: close the connections to it."""
        key = packed(member_id)
        with self._lock:
            gone = [self._senders.pop(each) for each in list(self._senders) if each[0] == key]
            self._opened.pop(key, None)
            self._unnoted.discard(key)
            if self._receipts and key in self._noted:
                self._noted.discard(key)
                self._receipts.end(key)
        for sender in gone:
            sender.close()

    def correspondents(self) -> set[str]:
        """The members that exchanged messages with this transport."""
        with self._lock:
            return {unpacked(member) for member in {member for member, _ in self._senders} | self._opened.keys()}

    def close(self) -> None:
        self._closed.set()
        with self._lock:
            senders = list(self._senders.values())
            self._senders.clear()
            if self._receipts:
                self._receipts.close()
        for sender in senders:
            sender.close()

    def _read_all(self) -> None:
        """Read the waiting messages of all senders, each of which has at most `AHEAD`."""
        read_at = time.monotonic()
        while len(self._turns) < MOST:
            message = self._queue.read()
            if message is None:
                return
            self._turns.add(_turn(message), (read_at, message))

    def _count(self, member: int) -> None:
        """Count an opened message of that sender."""
        self._opened[member] = opened = self._opened.get(member, 0) + 1
        self._unnoted.add(member)
        if opened % NOTED == 0:
            self.note()

    def note(self) -> None:
        """Show senders how many of their messages were opened. If that fails, it has to be called again."""
        unnoted = self._unnoted
        while unnoted:
            member = next(iter(unnoted))
            if member not in self._noted:
                try:
                    self._begin_to_note(member)
                except TransportError as exc:  # no descriptor, for example; the message is handled all the same
                    if self._sparing.may_tell():
                        log.warning("a sender is not told which requests were taken; trying again: %s", exc)
                    return
            unnoted.discard(member)
            if self._receipts:
                self._receipts.took(member, self._opened[member])

    def _begin_to_note(self, member: int) -> None:
        with self._lock:
            if self._closed.is_set():
                return
            self._open_receipts().begin(member)
            self._noted.add(member)

    def _open_receipts(self) -> Receipts:
        if self._receipts is None:
            self._receipts = Receipts(self._receipts_file)
        return self._receipts

    def _accept(self, message: Message, read_at: float) -> Job | None:
        request = request_at(message.octets, HEAD_BYTES)
        if message.to == CONFIRM:
            return partial(self.reply, message.member, message.line, request, 0.0, Reply(Status.OK))
        link = self.serving.get(message.to)
        line = message.line
        if line & WAKE_EARLY:
            line ^= WAKE_EARLY
            sender = self._senders.get((message.member, line))
            if sender and not self._turns:  # otherwise others are served, too, and no core is free for this client
                sender.announce()
        expires = read_at + request.remaining_ms / 1000 if request.remaining_ms != NO_DEADLINE else math.inf
        answer = partial(self.reply, message.member, line, request, expires)
        return dispatch(link, request, message.payload, read_at, answer)

    def _forward(self, message: Message) -> Job | None:
        header = reply_at(message.octets, HEAD_BYTES)
        caller = self.callers.get(header.client)
        return partial(caller.answered, message.member, header, message.payload) if caller else None

    def _new_sender(self, member: int, line: int) -> Sender | None:
        """A connection to that line; None if its member has gone."""
        with self._lock:
            if self._closed.is_set():
                return None
            if (member, line) not in self._senders:
                try:
                    self._senders[member, line] = Sender(self._node, self._own, unpacked(member), line)
                except TransportError:
                    if self._directory.alive(unpacked(member)):
                        raise
                    return None
            return self._senders[member, line]

    def _insist(self, send: partial[bool], member: int, end: float) -> None:
        """Send a reply to a client that has no room for it now."""

        def still() -> None:
            if not self._directory.alive(unpacked(member)):
                raise Closed("the client has gone")

        try:
            if not persist(send, end, still, self._closed) and self._sparing.may_tell():
                log.warning("a reply was dropped: the client does not receive")
        except Closed:
            return

    def _malformed(self, message: Message, why: DecodeError) -> None:
        link = self.serving.get(message.to)
        if link:
            link.malformed(why)
        elif not self._told:
            self._told = True
            log.warning("dropped a malformed message (further ones are dropped silently): %s", why)


def _turn(message: Message) -> int:
    """The key of a message in `Turns`: replies take turns apart from the requests of their sender."""
    return message.member if message.to else -message.member


def _nothing() -> None: ...
