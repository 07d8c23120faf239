"""Who commands and who calls."""

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
from .messages import Way, direct, octets
from .table import Token

if TYPE_CHECKING:
    from .transport import ZenohTransport


COMMANDS_AHEAD = 64
"""Commands that one sender may have on their way."""

_KEPT = 8
"""Messages for one line that nobody has read yet: an answer, late ones to earlier questions, and words of our own."""

_WAKE = b"wake"


def sent(to: Token) -> int:
    """The flag for a server that has our clock."""
    return Flag.SENT if to.traits == clock() else Flag.NONE


class Asking(Link):
    """A link that finds the one that serves its channel."""

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._found: tuple[int, Token, Way] | None = None
        self._finding = threading.Lock()

    def server(self) -> tuple[Token, Way]:
        """Who serves this channel, and the way to it. Raises Unreachable."""
        found, version = self._found, self.transport.table.version
        if found is None or found[0] != version:
            serving = self.counterparts(strict=True)
            if not serving:
                raise Unreachable(f"{self.channel.name}: no server")
            before = [token for token in serving if found and token.channel == found[1].channel]
            token = (before or serving)[-1]  # the one that came last: the other may be leaving
            key = self.address(token)
            with self._finding, self.using_the_session():
                found = self._found  # of several threads that are the first, one makes the way
                way = found[2] if found and found[2].key == key else Way(self.transport, key)
                found = self._found = version, token, way
        return found[1], found[2]

    def address(self, server: Token) -> str:
        return self.transport.key("rc", server.channel)


class CommandOutlet(Asking):
    role, facing = "commands", "receives"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
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
            server, way = self.server()
            header = pack_request(Flag.ONEWAY | sent(server), fingerprint, self.id, self._credit.sent, left)
            with self.using_the_session():
                way.put(header, payload, in_order=True)
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


class Line:
    """Questions numbered on their own, and where their answers come in."""

    def __init__(self, link: Link, handler: Any) -> None:
        """`handler` is what Zenoh gives the answers to."""
        self.id = link.transport.new_id()
        self.numbers = itertools.count(1)
        link.transport.lines[self.id] = link
        self.key = zenoh.KeyExpr(link.transport.address("rc_to", self.id))
        self.subscription = link.declare(link.transport.session.declare_subscriber(self.key, handler))

    def over(self, number: int, error: TransportError) -> None:
        """There will be no answer to that question."""
        raise NotImplementedError


class _OwnLine(Line):
    """Has one question at a time, and the thread that asked waits here itself, in a channel of Zenoh's.

    That has no patience of its own: who waits is woken when its time is over, by a message to itself.
    """

    def __init__(self, link: Link) -> None:
        super().__init__(link, zenoh.handlers.RingChannel(_KEPT))
        self._session = link.transport.session
        self._handler = self.subscription.handler
        self._over: tuple[int, TransportError] | None = None
        self.end = inf
        """Until when somebody waits here."""

    def begin(self, end: float) -> None:
        """Somebody asks; it may be a question that was over before."""
        self._over = None
        self.end = end

    def over(self, number: int, error: TransportError) -> None:
        self._over = number, error
        self.wake()

    def wake(self) -> None:
        """Have who waits here look why it does."""
        with contextlib.suppress(zenoh.ZError):  # closed, which wakes it as well
            self._session.put(self.key, b"", attachment=_WAKE, allowed_destination=zenoh.Locality.SESSION_LOCAL)

    def receive(self, number: int) -> zenoh.Sample | None:
        """What came in, or None if nothing did until `end`. Raises what the question is `over` by; ZError if closed."""
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
        """Forget what nobody waits for."""
        with contextlib.suppress(zenoh.ZError):
            while self._handler.try_recv() is not None:
                pass


class _SharedLine(Line):
    """Has many questions, and the crew attends to their answers."""

    def __init__(self, link: Link, pending: Pending, settle: Callable[[Line, zenoh.Sample], None]) -> None:
        self._do, self._pending = link.transport.do, pending
        super().__init__(link, direct(lambda answer: self._do(partial(settle, self, answer))))

    def over(self, number: int, error: TransportError) -> None:
        self._do(partial(self._pending.fail, number, error))


class Caller(Asking, SupportsQuestion):
    role, facing = "calls", "serves"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._flags = Flag.IDEMPOTENT if channel.idempotent else Flag.NONE
        self._lock = threading.Lock()
        self._idle: list[_OwnLine] = []
        self._shared: _SharedLine | None = None
        self._pending = Pending(channel.name)
        self._doubted: Token | None = None
        """The server that did not answer, while it is found out whether it is there."""
        self._under_way: dict[tuple[Line, int], int] = {}
        """Of each question the link that it was put to."""

    def address(self, server: Token) -> str:
        return self.transport.requests(server.link, server.channel)

    def question(self, payload: Payload) -> _Question:
        """What is asked under one number, however often."""
        self.check_open()
        return _Question(self, payload)

    def ask(self, payload: Payload, deadline: float) -> Reply:
        self.check_open()
        line = self.take()
        try:
            return self.ask_on(line, next(line.numbers), payload, deadline)
        finally:
            self.give(line)

    def ask_on(self, line: _OwnLine, number: int, payload: Payload, deadline: float) -> Reply:
        end = time.monotonic() + deadline
        self.check_open()
        line.begin(end)
        try:
            self._put(line, number, payload, end)
            self.transport.due(end)
            while (answer := line.receive(number)) is not None:
                found = self._understood(line, answer)
                if found and found[0] == number:
                    reply = found[1]
                    return reply if reply.status is not Status.MISMATCH else accepted(self.channel, reply)
        except zenoh.ZError as exc:
            raise self.failed(exc) from exc
        finally:
            silent = self._under_way.pop((line, number), None)
        self._doubt(silent)
        raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s")

    def call(self, payload: Payload, deadline: float, number: int = 0) -> Future[Reply]:
        end = time.monotonic() + deadline
        self.check_open()
        line = self._common_line()
        number = number or next(line.numbers)
        future = self._pending.add(number, deadline)
        future.add_done_callback(lambda _: self._forget(line, number))
        try:
            self._put(line, number, payload, end)
        except BaseException:
            future.cancel()
            raise
        finally:
            if future.done():  # perhaps before it was noted as under way
                self._forget(line, number)
        self.transport.due(end)
        return future

    def look(self) -> bool:
        under_way = list(self._under_way.items())  # first: of whom these ask, all were told
        there = {token.link for token in self.counterparts()}
        for (line, number), server in under_way:
            if server not in there:
                line.over(number, Unreachable(f"{self.channel.name}: its server left"))
        self.has_news()
        return True

    def tick(self) -> float | None:
        with self._lock:
            for line in self._idle:
                line.empty()
        now, waits = time.monotonic(), [self._pending.expire(self.transport.do)]
        for line in {line for line, _ in list(self._under_way) if isinstance(line, _OwnLine)}:
            if line.end <= now:
                line.wake()
            else:
                waits.append(line.end - now)
        return min((wait for wait in waits if wait is not None), default=None)

    def release(self) -> None:
        closed = Closed(f"{self.channel.name}: the link is closed")
        for line, number in list(self._under_way):
            line.over(number, closed)
        self._pending.close(closed)

    def _doubt(self, link: int | None) -> None:
        """Somebody did not answer: find out whether it is there at all."""
        found = self._found
        if self._doubted is None and found and found[1].link == link:
            self._doubted = found[1]
            self.transport.do(self._find_out)

    def _find_out(self) -> None:
        try:
            if self._doubted:
                self.transport.confirm(self._doubted)
        finally:
            self._doubted = None

    def new_number(self) -> int:
        """One for `call`."""
        return next(self._common_line().numbers)

    def give(self, line: _OwnLine) -> None:
        self._idle.append(line)

    def take(self) -> _OwnLine:
        """A line for the calling thread alone; it must `give` it back."""
        with self._lock:
            if self._idle:
                return self._idle.pop()
        with self.using_the_session():
            return _OwnLine(self)

    def _common_line(self) -> _SharedLine:
        with self._lock, self.using_the_session():
            if self._shared is None:
                self._shared = _SharedLine(self, self._pending, self._settle)
            return self._shared

    def _forget(self, line: Line, number: int) -> None:
        if not self._pending.knows(number):  # it is not asked again
            self._under_way.pop((line, number), None)

    def _put(self, line: Line, number: int, payload: Payload, end: float) -> None:
        under_way, question = self._under_way, (line, number)
        server, way = self.server()
        while under_way.get(question) != server.link:
            under_way[question] = server.link  # from now on its end is told if that server leaves
            server, way = self.server()  # unless it has left
        self.check_open()
        left = end - time.monotonic()
        header = pack_request(self._flags | sent(server), self.channel.type.fingerprint, line.id, number, left)
        try:
            way.put(header, payload)
        except zenoh.ZError as exc:
            raise self.failed(exc) from exc

    def _understood(self, line: Line, answer: zenoh.Sample) -> tuple[int, Reply] | None:
        """The number of a question, and what was answered to it; None if that was nothing of ours."""
        try:
            header = read_reply(octets(answer.attachment))
            reply = answered((STATUSES[header.status], answer.payload.to_bytes()))
        except (ValueError, KeyError) as exc:
            self.malformed(exc)
            return None
        if header.client != line.id:
            self.malformed("the answer to somebody else's question")
            return None
        return header.sequence, reply

    def _settle(self, line: Line, answer: zenoh.Sample) -> None:
        found = self._understood(line, answer)
        if found is None:
            return
        number, reply = found
        try:
            self._pending.settle(number, accepted(self.channel, reply))
        except ContractMismatch as exc:
            self._pending.fail(number, exc)


class _Question:
    """Keeps the line that it was asked on, since that is what servers know it by."""

    def __init__(self, caller: Caller, payload: Payload) -> None:
        self._caller, self._payload = caller, payload
        self._line: _OwnLine | None = None
        self._number = 0

    def ask(self, deadline: float) -> Reply:
        if self._line is None:
            self._line = self._caller.take()
            self._number = next(self._line.numbers)
        return self._caller.ask_on(self._line, self._number, self._payload, deadline)

    def call(self, deadline: float) -> Future[Reply]:
        self._number = self._number or self._caller.new_number()
        return self._caller.call(self._payload, deadline, self._number)

    def close(self) -> None:
        if self._line:
            self._caller.give(self._line)
            self._line = None
