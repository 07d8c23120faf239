"""The client's links: a command outlet and a caller."""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any

import zenoh

from ...errors import Closed, ContractMismatch, Timeout, TransportError, Unreachable
from ...wire.codec import Payload
from ...wire.header import (
    Flag,
    clock,
    pack_request,
    read_reply,
)
from ..base import (
    STATUSES,
    Channel,
    Reply,
    Status,
    SupportsQuestion,
    answered,
)
from ..credit import Credit
from ..link import accepted
from ..pending import Pending
from .link import Link
from .messages import Destination, direct, octets
from .table import Token

if TYPE_CHECKING:
    from .core import ZenohCore


COMMANDS_AHEAD = 64
"""Maximum number of unacknowledged commands of one sender."""

_INBOX_SIZE = 8
"""Maximum number of unread messages in a reply inbox: a reply, late replies to earlier requests, wake-ups."""

_WAKE = b"wake"


def clock_flag(server: Token) -> int:
    """SENT if the server is on this host: its deadline then counts from the time of sending."""
    return Flag.SENT if server.traits == clock() else Flag.NONE


class ClientLink(Link):
    """A link that finds the server of its channel."""

    def __init__(self, transport: ZenohCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._server: tuple[int, Token, Destination] | None = None
        self._destination_lock = threading.Lock()

    def server(self) -> tuple[Token, Destination]:
        """The server of this channel and the destination of messages to it. Raises Unreachable."""
        found, version = self._server, self.transport.table.version
        if found is None or found[0] != version:
            serving = self.counterparts(strict=True)
            if not serving:
                raise Unreachable(f"{self.channel.name}: no server")
            before = [token for token in serving if found and token.channel == found[1].channel]
            token = (before or serving)[-1]  # the newest: the others may be leaving
            key = self.address(token)
            with self._destination_lock, self.using_the_session():
                found = self._server  # another thread may have made the destination
                destination = found[2] if found and found[2].key == key else Destination(self.transport.session, key)
                found = self._server = version, token, destination
        return found[1], found[2]

    def address(self, server: Token) -> str:
        return self.transport.key("rc", server.channel)


class CommandOutlet(ClientLink):
    role, facing = "commands", "receives"

    def __init__(self, transport: ZenohCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._order = threading.Lock()
        self._credit = Credit(COMMANDS_AHEAD, self._reader)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        self.take_turn(self._order, deadline)
        try:
            self.check_open()
            if not self._credit.wait(end, self.check_open, len(payload)):
                raise self._too_slow(deadline)
            fingerprint, left = self.channel.type.fingerprint, end - time.monotonic()
            server, destination = self.server()
            header = pack_request(Flag.ONEWAY | clock_flag(server), fingerprint, self.id, self._credit.sent, left)
            with self.using_the_session():
                destination.put(header, payload, in_order=True)
        finally:
            self._order.release()

    def acknowledged(self, by: int, sequence: int) -> None:
        self._credit.took(by, sequence)

    def _reader(self) -> dict[int, int]:
        server, _ = self.server()
        if self.transport.has_left(server.channel):
            raise Unreachable(f"{self.channel.name}: its server left")
        return {server.link: server.since}

    def _too_slow(self, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")


class ReplyInbox:
    """Receives the replies to requests that it numbers. Servers know it as one client."""

    def __init__(self, link: Link, handler: Any) -> None:
        """`handler` receives the replies from Zenoh."""
        self.id = link.transport.new_id()
        self.numbers = itertools.count(1)
        link.transport.links_by_id[self.id] = link
        self.key = zenoh.KeyExpr(link.transport.address("rc_to", self.id))
        self.subscription = link.declare(link.transport.session.declare_subscriber(self.key, handler))

    def over(self, number: int, error: TransportError) -> None:
        """Report that the request with this number gets no reply."""
        raise NotImplementedError


class _BlockingInbox(ReplyInbox):
    """Serves one blocking call at a time; the calling thread waits in a Zenoh channel.

    Waiting there has no time limit, so at the deadline `tick` wakes the thread with a message.
    """

    def __init__(self, link: Link) -> None:
        super().__init__(link, zenoh.handlers.RingChannel(_INBOX_SIZE))
        self._session = link.transport.session
        self._handler = self.subscription.handler
        self._over: tuple[int, TransportError] | None = None
        self.end = inf
        """The deadline of the call that waits here."""

    def begin(self, end: float) -> None:
        """Start a call, perhaps the retry of a request that `over` ended."""
        self._over = None
        self.end = end

    def over(self, number: int, error: TransportError) -> None:
        self._over = number, error
        self.wake()

    def wake(self) -> None:
        """Make the waiting thread check for an error and for its deadline."""
        with contextlib.suppress(zenoh.ZError):  # closed, which wakes it as well
            self._session.put(self.key, b"", attachment=_WAKE, allowed_destination=zenoh.Locality.SESSION_LOCAL)

    def receive(self, number: int) -> zenoh.Sample | None:
        """The next reply; None at `end`. Raises the error that `over` was given, or ZError if the inbox is closed."""
        while True:
            got: zenoh.Sample = self._handler.recv()
            if got.payload or got.attachment is None or got.attachment.to_bytes() != _WAKE:
                return got
            over = self._over
            if over and over[0] == number:
                raise over[1]
            if time.monotonic() >= self.end:
                return None

    def empty(self) -> None:
        """Drop replies that came too late."""
        with contextlib.suppress(zenoh.ZError):
            while self._handler.try_recv() is not None:
                pass


class _SharedInbox(ReplyInbox):
    """Serves many calls at a time; the transport's threads handle the replies."""

    def __init__(self, link: Link, pending: Pending, settle: Callable[[ReplyInbox, zenoh.Sample], None]) -> None:
        self._do, self._pending = link.transport.do, pending
        super().__init__(link, direct(lambda answer: self._do(partial(settle, self, answer))))

    def over(self, number: int, error: TransportError) -> None:
        self._do(partial(self._pending.fail, number, error))


class Caller(ClientLink, SupportsQuestion):
    role, facing = "calls", "serves"

    def __init__(self, transport: ZenohCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._flags = Flag.IDEMPOTENT if channel.idempotent else Flag.NONE
        self._lock = threading.Lock()
        self._idle: list[_BlockingInbox] = []
        self._shared: _SharedInbox | None = None
        self._pending = Pending(channel.name)
        self._probed: Token | None = None
        """The server that did not answer, while `_probe` checks whether it exists."""
        self._open_requests: dict[tuple[ReplyInbox, int], int] = {}
        """The server of each open request."""

    def address(self, server: Token) -> str:
        return self.transport.requests(server.link, server.channel)

    def question(self, payload: Payload) -> _BoundQuery:
        """A request that keeps its number over all retries."""
        self.check_open()
        return _BoundQuery(self, payload)

    def ask(self, payload: Payload, deadline: float) -> Reply:
        self.check_open()
        inbox = self.take()
        try:
            return self.ask_on(inbox, next(inbox.numbers), payload, deadline)
        finally:
            self.give(inbox)

    def ask_on(self, inbox: _BlockingInbox, number: int, payload: Payload, deadline: float) -> Reply:
        end = time.monotonic() + deadline
        self.check_open()
        inbox.begin(end)
        try:
            self._put(inbox, number, payload, end)
            self.transport.due(end)
            while (answer := inbox.receive(number)) is not None:
                found = self._decoded(inbox, answer)
                if found and found[0] == number:
                    reply = found[1]
                    return reply if reply.status is not Status.MISMATCH else accepted(self.channel, reply)
        except zenoh.ZError as exc:
            raise self.failed(exc) from exc
        finally:
            silent = self._open_requests.pop((inbox, number), None)
        self._start_probe(silent)
        raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s")

    def call(self, payload: Payload, deadline: float, number: int = 0) -> Future[Reply]:
        end = time.monotonic() + deadline
        self.check_open()
        inbox = self._get_shared_inbox()
        number = number or next(inbox.numbers)
        future = self._pending.add(number, deadline)
        future.add_done_callback(lambda _: self._forget(inbox, number))
        try:
            self._put(inbox, number, payload, end)
        except BaseException:
            future.cancel()
            raise
        finally:
            if future.done():  # perhaps before `_put` noted the request
                self._forget(inbox, number)
        self.transport.due(end)
        return future

    def look(self) -> bool:
        open_requests = list(self._open_requests.items())  # before the peers: the table knew these servers
        there = {token.link for token in self.counterparts()}
        for (inbox, number), server in open_requests:
            if server not in there:
                inbox.over(number, Unreachable(f"{self.channel.name}: its server left"))
        self.has_news()
        return True

    def tick(self) -> float | None:
        with self._lock:
            for inbox in self._idle:
                inbox.empty()
        now, waits = time.monotonic(), [self._pending.expire(self.transport.do)]
        for inbox in {inbox for inbox, _ in list(self._open_requests) if isinstance(inbox, _BlockingInbox)}:
            if inbox.end <= now:
                inbox.wake()
            else:
                waits.append(inbox.end - now)
        return min((wait for wait in waits if wait is not None), default=None)

    def release(self) -> None:
        closed = Closed(f"{self.channel.name}: the link is closed")
        for inbox, number in list(self._open_requests):
            inbox.over(number, closed)
        self._pending.close(closed)

    def _start_probe(self, link: int | None) -> None:
        """A server did not answer: check whether it still exists."""
        found = self._server
        if self._probed is None and found and found[1].link == link:
            self._probed = found[1]
            self.transport.do(self._probe)

    def _probe(self) -> None:
        try:
            if self._probed:
                self.transport.confirm(self._probed)
        finally:
            self._probed = None

    def new_number(self) -> int:
        """A request number for `call`."""
        return next(self._get_shared_inbox().numbers)

    def give(self, inbox: _BlockingInbox) -> None:
        self._idle.append(inbox)

    def take(self) -> _BlockingInbox:
        """A reply inbox for the calling thread only, which must `give` it back."""
        with self._lock:
            if self._idle:
                return self._idle.pop()
        with self.using_the_session():
            return _BlockingInbox(self)

    def _get_shared_inbox(self) -> _SharedInbox:
        with self._lock, self.using_the_session():
            if self._shared is None:
                self._shared = _SharedInbox(self, self._pending, self._settle)
            return self._shared

    def _forget(self, inbox: ReplyInbox, number: int) -> None:
        if not self._pending.knows(number):  # no retry has the same number
            self._open_requests.pop((inbox, number), None)

    def _put(self, inbox: ReplyInbox, number: int, payload: Payload, end: float) -> None:
        open_requests, request = self._open_requests, (inbox, number)
        server, destination = self.server()
        while open_requests.get(request) != server.link:
            open_requests[request] = server.link  # from now on `look` ends the request if that server leaves
            server, destination = self.server()  # checks that it has not left before
        self.check_open()
        left = end - time.monotonic()
        header = pack_request(self._flags | clock_flag(server), self.channel.type.fingerprint, inbox.id, number, left)
        try:
            destination.put(header, payload)
        except zenoh.ZError as exc:
            raise self.failed(exc) from exc

    def _decoded(self, inbox: ReplyInbox, answer: zenoh.Sample) -> tuple[int, Reply] | None:
        """The request number and the reply; None if the message is malformed."""
        try:
            header = read_reply(octets(answer.attachment))
            reply = answered((STATUSES[header.status], answer.payload.to_bytes()))
        except (ValueError, KeyError) as exc:
            self.malformed(exc)
            return None
        if header.client != inbox.id:
            self.malformed("the reply belongs to another client")
            return None
        return header.sequence, reply

    def _settle(self, inbox: ReplyInbox, answer: zenoh.Sample) -> None:
        found = self._decoded(inbox, answer)
        if found is None:
            return
        number, reply = found
        try:
            self._pending.settle(number, accepted(self.channel, reply))
        except ContractMismatch as exc:
            self._pending.fail(number, exc)


class _BoundQuery:
    """Keeps its reply inbox: servers recognize a retry by the inbox's id and the number."""

    def __init__(self, caller: Caller, payload: Payload) -> None:
        self._caller, self._payload = caller, payload
        self._inbox: _BlockingInbox | None = None
        self._number = 0

    def ask(self, deadline: float) -> Reply:
        if self._inbox is None:
            self._inbox = self._caller.take()
            self._number = next(self._inbox.numbers)
        return self._caller.ask_on(self._inbox, self._number, self._payload, deadline)

    def call(self, deadline: float) -> Future[Reply]:
        self._number = self._number or self._caller.new_number()
        return self._caller.call(self._payload, deadline, self._number)

    def close(self) -> None:
        if self._inbox:
            self._caller.give(self._inbox)
            self._inbox = None
