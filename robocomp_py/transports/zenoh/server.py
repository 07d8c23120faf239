"""The server's links: a command inlet and a server."""

from __future__ import annotations

import logging
import math
import threading
import time
from functools import partial
from typing import TYPE_CHECKING

import zenoh

from ...errors import DecodeError, TransportError
from ...wire.codec import Payload
from ...wire.header import (
    NO_DEADLINE,
    Flag,
    Request,
    client_of,
    clock,
    pack_reply,
    read_request,
)
from ..base import (
    Channel,
    Reply,
    Service,
    Sink,
    Status,
)
from ..exclusive import Claim, claim
from ..leader_followers import CommandLane, Servant
from ..ledger import Ledger
from ..limits import QUERIES_WAITING
from ..replies import Replies
from ..senders import From
from ..turns import Turns
from .link import INBOX, Link, Receiving
from .messages import Message, MessageReplier, QueryReplier, direct, octets

if TYPE_CHECKING:
    from .core import ZenohCore

log = logging.getLogger("robocomp.transport.zenoh")

LEAVING = 3.0
"""Seconds for which the token of a closed server may remain visible when the next server starts."""

_SILENCE = Reply(Status.OK)
"""Stands for no reply at all."""


class CommandInlet(Receiving):
    role, facing = "receives", "commands"

    def __init__(self, transport: ZenohCore, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self.traits = clock()
        self._ledger = Ledger(self.stats, ordered=True)
        self.lane = CommandLane(channel.name, _copied_for(sink), self.stats)

    def open(self) -> None:
        self._claim = _claim(self)
        super().open()

    def take(self, message: Message) -> tuple[int, int] | None:
        request = read_request(octets(message.attachment))
        if request.fingerprint != self.channel.type.fingerprint:
            self.meet_stranger(request.client, request.fingerprint)
            return None
        if self._ledger.admit(request.client, request.sequence):
            self.lane.take(self.signed(request.client, message.payload), _expires(request, message.arrived))
        return request.client, request.sequence

    def release(self) -> None:
        if self._claim:
            self._claim.close()
        super().release()


class Server(Link):
    role, facing = "serves", "calls"

    def __init__(self, transport: ZenohCore, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self.traits = clock()
        self._servant = Servant(channel.name, service, self.stats)
        self._ledger = Ledger(self.stats, ordered=False)
        self._lock = threading.Lock()
        self._waiting: Turns[tuple[zenoh.Sample | zenoh.Query, float]] = Turns()
        self._replies = Replies() if channel.idempotent else None
        self._open_requests: dict[tuple[int, int], tuple[QueryReplier | MessageReplier, float]] = {}

    def open(self) -> None:
        self._claim = _claim(self)
        session, mine = self.transport.session, self.transport.requests(self.id, self.channel.name)
        self.declare(session.declare_subscriber(mine, direct(self._on_request)))
        self.declare(session.declare_queryable(self.key, direct(self._on_request), complete=True))

    def tick(self) -> None:
        now = time.monotonic()
        with self._lock:
            over = [key for key, (_, expires) in self._open_requests.items() if expires <= now]
        for key in over:
            self._forget(*key)

    def release(self) -> None:
        if self._claim:
            self._claim.close()
        self._servant.close()
        for key in list(self._open_requests):
            self._forget(*key)

    def _on_request(self, message: zenoh.Sample | zenoh.Query) -> None:
        if len(self._waiting) < INBOX:
            sender = client_of(octets(message.attachment)) if self._waiting else 0  # an empty queue needs no turns
            self._waiting.add(sender, (message, time.monotonic()))
            self.transport.do(self._next)
        else:
            self.stats.dropped += 1
            if isinstance(message, zenoh.Query):
                message.drop()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it

    def _next(self) -> None:
        message, arrived = self._waiting.take()
        query = QueryReplier(message) if isinstance(message, zenoh.Query) else None
        try:
            request = read_request(octets(message.attachment))
        except DecodeError as exc:
            self.malformed(exc)
            if query:
                query.close()
            return
        replier = query or MessageReplier(self.transport.session, self.transport.address("rc_to", request.client))
        expires = _expires(request, arrived)
        refusal = self._admit(request, replier, expires)
        if refusal is None:
            payload = message.payload
            octets_of = payload.to_bytes() if payload is not None else b""
            self._serve(request, self.signed(request.client, octets_of), expires)
            return
        if refusal is not _SILENCE:
            self._send(replier, request, refusal)
        replier.close()

    def _admit(self, request: Request, replier: QueryReplier | MessageReplier, expires: float) -> Reply | None:
        """Note a request as open; returns a reply if it is not to be executed."""
        mine = self.channel.type
        if request.fingerprint != mine.fingerprint:
            self.meet_stranger(request.client, request.fingerprint)
            return Reply(Status.MISMATCH, mine.text.encode())
        with self._lock:
            if not self._ledger.admit(request.client, request.sequence):
                known = self._known(request)
                if known:
                    return known
            if len(self._open_requests) >= QUERIES_WAITING or len(self._waiting) >= QUERIES_WAITING:
                self.stats.dropped += 1
                return Reply(Status.BUSY)
            self._open_requests[request.client, request.sequence] = replier, expires
        return None

    def _known(self, request: Request) -> Reply | None:
        """The reply to a request that arrives again; None if it has to be executed again."""
        number = request.client, request.sequence
        if not request.flags & Flag.IDEMPOTENT or self._replies is None or number in self._open_requests:
            return _SILENCE
        return self._replies.find(number)

    def _serve(self, request: Request, payload: bytes, expires: float) -> None:
        answer = partial(self._answer, request)
        if not self._servant.serve(payload, expires, answer):
            answer(Reply(Status.REFUSED))

    def _answer(self, request: Request, reply: Reply) -> None:
        if self._replies is not None:  # before the pop: a retry finds the request either open or answered
            self._replies.keep((request.client, request.sequence), reply)
        with self._lock:
            replier, _ = self._open_requests.pop((request.client, request.sequence), (None, 0.0))
        if replier:
            self._send(replier, request, reply)
            replier.close()

    def _send(self, replier: QueryReplier | MessageReplier, request: Request, reply: Reply) -> None:
        try:
            replier.reply(self._header(reply.status, request), reply.payload)
        except zenoh.ZError as exc:
            log.debug("%s: a reply was not sent: %s", self.channel.name, exc)

    def _forget(self, client: int, sequence: int) -> None:
        with self._lock:
            replier, _ = self._open_requests.pop((client, sequence), (None, 0.0))
        if replier:
            replier.close()

    def _header(self, status: Status, request: Request) -> bytes:
        return pack_reply(status, request.client, request.sequence, self.transport.incarnation)


def _copied_for(sink: Sink) -> Sink:
    """A sink for payloads of Zenoh, which are copied when it is their turn."""

    def deliver(payload: Payload) -> object:
        if type(payload) is From:
            return sink(From(payload.sender, payload.payload.to_bytes()))
        return sink(payload.to_bytes())

    return deliver


def _expires(request: Request, arrived: float) -> float:
    remaining = math.inf if request.remaining_ms == NO_DEADLINE else request.remaining_ms / 1000
    return (time.monotonic() if request.flags & Flag.SENT else arrived) + remaining


def _claim(link: Link) -> Claim:
    """Claim a channel, on this host and on all others. Raises TransportError if it has a server already."""
    transport, name = link.transport, link.channel.name
    claimed = claim(transport.claims, name, transport.owner)
    end, changed = time.monotonic() + LEAVING, transport.table.changed
    while others := transport.table.find(link.role, name):
        if time.monotonic() >= end:
            claimed.close()
            raise TransportError(f"{name}: already served from another host, by pid {others[0].pid} there")
        if time.monotonic() >= end - LEAVING / 2:
            for each in others:
                transport.confirm(each)
        with changed:
            changed.wait(0.02)
    return claimed
