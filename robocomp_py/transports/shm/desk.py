"""Where letters are opened and answered: what comes in by mail is for a link, and its answer goes back by mail."""

from __future__ import annotations

import logging
import threading
import time
from functools import partial
from typing import TYPE_CHECKING

from ...errors import Closed, DecodeError, TransportError
from ...wire.header import NO_DEADLINE, Flag, Request, pack_reply, reply_at, request_at
from ..base import Reply, Status
from ..crew import Job
from ..sparing import Sparing
from .mail import HURRY, KNOCK, Mailbox, Post, packed, persist, unpacked
from .samples import HEAD_BYTES, Message, size_of

if TYPE_CHECKING:
    from ..served import ServingLink
    from .asking import Caller
    from .transport import ShmTransport

log = logging.getLogger("robocomp.transport.shm")

INSISTING = 5.0
"""Seconds for which room is sought for a reply, if its caller has not said how long he waits."""


class Desk:
    """`open_next` is for one thread at a time; replies may come from any."""

    def __init__(self, transport: ShmTransport, mailbox: Mailbox) -> None:
        self._transport, self._mailbox = transport, mailbox
        self._own, self._incarnation = packed(transport.member.id), transport.incarnation
        self.serving: dict[int, ServingLink] = {}
        """By the number that letters to them bear."""
        self.callers: dict[int, Caller] = {}
        """By the client that replies to them name."""
        self._posts: dict[tuple[int, int], Post] = {}
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._sparing = Sparing()
        self._told = False
        """Whether it was said that there are malformed letters."""

    def open_next(self) -> Job | None:
        """What is to be done about the next letter; None if there is none."""
        message = self._mailbox.read()
        if message is None:
            return None
        try:
            return (self._accept(message) if message.to else self._forward(message)) or _nothing
        except DecodeError as exc:
            self._malformed(message, exc)
            return _nothing

    def reply(self, member: int, line: int, request: Request, expires: float, reply: Reply) -> None:
        try:
            post = self._posts.get((member, line)) or self._new_post(member, line)
            if post is None:
                return  # who asked has gone
            payload = b"" if reply.payload is None else reply.payload
            header = pack_reply(reply.status, request.client, request.sequence, self._incarnation)
            size = size_of(payload)
            if not post.send(0, 0, header, payload, size):
                send = partial(post.send, 0, 0, header, payload, size)
                self._transport.do(partial(self._insist, send, member, min(expires, time.monotonic() + INSISTING)))
        except TransportError as exc:
            if self._sparing.may_tell():
                log.error("a reply could not be sent: %s", exc)
            if reply.status is not Status.FAILED and not self._closed.is_set():
                self.reply(member, line, request, expires, Reply(Status.FAILED))

    def drop(self, member_id: str) -> None:
        """Nobody reads there any more."""
        key = packed(member_id)
        with self._lock:
            gone = [self._posts.pop(each) for each in list(self._posts) if each[0] == key]
        for post in gone:
            post.close()

    def correspondents(self) -> set[str]:
        """To whom we have written."""
        with self._lock:
            return {unpacked(member) for member, _ in self._posts}

    def close(self) -> None:
        self._closed.set()
        with self._lock:
            posts = list(self._posts.values())
            self._posts.clear()
        for post in posts:
            post.close()

    def _accept(self, message: Message) -> Job | None:
        request = request_at(message.octets, HEAD_BYTES)
        if message.to == KNOCK:
            return partial(self.reply, message.member, message.line, request, 0.0, Reply(Status.OK))
        link = self.serving.get(message.to)
        limited = request.remaining_ms != NO_DEADLINE
        expires = time.monotonic() + request.remaining_ms / 1000 if limited else float("inf")
        line = message.line
        if line & HURRY:
            line ^= HURRY
            post = self._posts.get((message.member, line))
            if post:
                post.announce()
        answer = partial(self.reply, message.member, line, request, expires)
        if link is None:
            return None if request.flags & Flag.ONEWAY else partial(answer, Reply(Status.REFUSED))
        if request.fingerprint != link.channel.type.fingerprint:
            link.refuse_stranger(request)
            return partial(answer, Reply(Status.MISMATCH, link.channel.type.text.encode()))
        return link.take(request, message.payload, expires, answer)

    def _forward(self, message: Message) -> Job | None:
        header = reply_at(message.octets, HEAD_BYTES)
        caller = self.callers.get(header.client)
        return partial(caller.answered, message.member, header, message.payload) if caller else None

    def _new_post(self, member: int, line: int) -> Post | None:
        """None if nobody reads there any more."""
        with self._lock:
            if self._closed.is_set():
                return None
            if (member, line) not in self._posts:
                try:
                    self._posts[member, line] = Post(self._transport.node, self._own, unpacked(member), line)
                except TransportError:
                    if self._transport.directory.alive(unpacked(member)):
                        raise
                    return None
            return self._posts[member, line]

    def _insist(self, send: partial[bool], member: int, end: float) -> None:
        """Send a reply to somebody who has no room for it now."""

        def still() -> None:
            if not self._transport.directory.alive(unpacked(member)):
                raise Closed("who asked has gone")

        try:
            if not persist(send, end, still, self._closed) and self._sparing.may_tell():
                log.warning("a reply was dropped: who asked does not take it")
        except Closed:
            return

    def _malformed(self, message: Message, why: DecodeError) -> None:
        link = self.serving.get(message.to)
        if link:
            link.malformed(why)
        elif not self._told:
            self._told = True
            log.warning("dropped a malformed letter (further ones are dropped silently): %s", why)


def _nothing() -> None: ...
