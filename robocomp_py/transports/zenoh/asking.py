"""Who commands and who calls."""

from __future__ import annotations

import itertools
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import zenoh

from ...errors import Closed, ContractMismatch, Timeout, TransportError, Unreachable
from ...wire.codec import Payload
from ...wire.header import (
    Flag,
    pack_request,
    read_reply,
)
from ..base import (
    Channel,
    Reply,
    Status,
    TypeRef,
    mismatch,
)
from ..pending import Pending
from .credit import Credit
from .link import TICK, Link, within
from .messages import direct, halves, octets
from .table import Token

if TYPE_CHECKING:
    from .transport import ZenohTransport


COMMANDS_AHEAD = 64
"""Commands that one sender may have on their way."""

_LONGEST_WAIT = 3600.0
"""Seconds that one wait may take; Python refuses to wait for ever so long."""


class Asking(Link):
    """A link that finds the one that serves its channel."""

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._found: tuple[int, Token, zenoh.KeyExpr] | None = None

    def server(self) -> tuple[Token, zenoh.KeyExpr]:
        """Who serves this channel, and the key to reach it. Raises Unreachable."""
        found, version = self._found, self.transport.table.version
        if found is None or found[0] != version:
            serving = self.counterparts(strict=True)
            if not serving:
                raise Unreachable(f"{self.channel.name}: nobody serves it")
            before = [token for token in serving if found and token.channel == found[1].channel]
            token = (before or serving)[-1]  # the one that came last: the other may be leaving
            found = self._found = version, token, zenoh.KeyExpr(self.address(token))
        return found[1:]

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
        with within(self._order, self._too_slow(deadline), end):
            self.check_open()
            if not self._credit.wait(end, self.check_open, len(payload)):
                raise self._too_slow(deadline)
            fingerprint, left = self.channel.type.fingerprint, end - time.monotonic()
            header = pack_request(Flag.ONEWAY, fingerprint, self.id, self._credit.sent, left)
            with self.using_the_session():
                self.transport.put(self.server()[1], header, payload, in_order=True)

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

    def __init__(self, link: Link, heard: Callable[[zenoh.Sample], object]) -> None:
        """`heard` is called on a thread of Zenoh."""
        self.id = link.transport.new_id()
        self.numbers = itertools.count(1)
        link.transport.lines[self.id] = link
        key = link.transport.key("rc_to", *halves(self.id))
        link.declare(link.transport.session.declare_subscriber(key, direct(heard)))

    def over(self, number: int, error: TransportError) -> None:
        """There will be no answer to that question."""
        raise NotImplementedError


class _Over(NamedTuple):
    number: int
    error: TransportError


class _OwnLine(Line):
    """Has one question at a time, and the thread that asked waits here itself."""

    def __init__(self, link: Link) -> None:
        self._box: queue.SimpleQueue[zenoh.Sample | _Over] = queue.SimpleQueue()
        super().__init__(link, self._box.put)

    def over(self, number: int, error: TransportError) -> None:
        self._box.put(_Over(number, error))

    def receive(self, number: int, end: float) -> zenoh.Sample | None:
        """What came in, or None if nothing did until `end`. Raises what the question is `over` by."""
        while (left := end - time.monotonic()) > 0:
            try:
                got = self._box.get(timeout=min(left, _LONGEST_WAIT))
            except queue.Empty:
                continue
            if not isinstance(got, _Over):
                return got
            if got.number == number:
                raise got.error
        return None

    def empty(self) -> None:
        """Forget what nobody waits for."""
        while not self._box.empty():
            self._box.get()


class _SharedLine(Line):
    """Has many questions, and the crew attends to their answers."""

    def __init__(self, link: Link, pending: Pending, settle: Callable[[Line, zenoh.Sample], None]) -> None:
        self._do, self._pending = link.transport.do, pending
        super().__init__(link, lambda answer: self._do(partial(settle, self, answer)))

    def over(self, number: int, error: TransportError) -> None:
        self._do(partial(self._pending.fail, number, error))


class Caller(Asking):
    role, facing = "calls", "serves"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._flags = Flag.IDEMPOTENT if channel.idempotent else Flag.NONE
        self._lock = threading.Lock()
        self._idle: list[_OwnLine] = []
        self._shared: _SharedLine | None = None
        self._pending = Pending(channel.name)
        self._under_way: dict[tuple[Line, int], int] = {}
        """Of each question the link that it was put to."""

    def address(self, server: Token) -> str:
        return self.transport.key("rc_to", *halves(server.link))

    def ask(self, payload: Payload, deadline: float) -> Reply:
        end = time.monotonic() + deadline
        self.check_open()
        line = self._take()
        number = next(line.numbers)
        try:
            self._put(line, number, payload, end)
            while (answer := line.receive(number, end)) is not None:
                found = self._understood(line, answer)
                if found and found[0] == number:
                    return self._accepted(found[1])
        finally:
            self._under_way.pop((line, number), None)
            self._idle.append(line)
        raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s")

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        end = time.monotonic() + deadline
        self.check_open()
        line = self._common_line()
        number = next(line.numbers)
        future = self._pending.add(number, deadline)
        future.add_done_callback(lambda _: self._under_way.pop((line, number), None))
        try:
            self._put(line, number, payload, end)
        except BaseException:
            future.cancel()
            raise
        finally:
            if future.done():  # perhaps before it was noted as under way
                self._under_way.pop((line, number), None)
        if deadline < TICK:
            self.transport.tick_soon()
        return future

    def look(self) -> None:
        there = {token.link for token in self.counterparts()}
        for (line, number), server in list(self._under_way.items()):
            if server not in there:
                line.over(number, Unreachable(f"{self.channel.name}: its server left"))

    def tick(self) -> float | None:
        with self._lock:
            for line in self._idle:
                line.empty()
        return self._pending.expire(self.transport.do)

    def release(self) -> None:
        closed = Closed(f"{self.channel.name}: the link is closed")
        for line, number in list(self._under_way):
            line.over(number, closed)
        self._pending.close(closed)

    def _take(self) -> _OwnLine:
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

    def _put(self, line: Line, number: int, payload: Payload, end: float) -> None:
        server, key = self.server()
        while self._under_way.get((line, number)) != server.link:
            self._under_way[line, number] = server.link  # from now on its end is told if that server leaves
            server, key = self.server()  # unless it has left
        self.check_open()
        left = end - time.monotonic()
        header = pack_request(self._flags, self.channel.type.fingerprint, line.id, number, left)
        with self.using_the_session():
            self.transport.put(key, header, payload)

    def _understood(self, line: Line, answer: zenoh.Sample) -> tuple[int, Reply] | None:
        """The number of a question, and what was answered to it; None if that was nothing of ours."""
        try:
            header = read_reply(octets(answer.attachment))
            reply = Reply(Status(header.status), answer.payload.to_bytes())
        except ValueError as exc:
            self.malformed(exc)
            return None
        if header.client != line.id:
            self.malformed("the answer to somebody else's question")
            return None
        return header.sequence, reply

    def _accepted(self, reply: Reply) -> Reply:
        if reply.status is Status.MISMATCH:
            raise ContractMismatch(mismatch(self.channel, TypeRef("", 0, reply.payload.decode(errors="replace"))))
        return reply

    def _settle(self, line: Line, answer: zenoh.Sample) -> None:
        found = self._understood(line, answer)
        if found is None:
            return
        number, reply = found
        try:
            self._pending.settle(number, self._accepted(reply))
        except ContractMismatch as exc:
            self._pending.fail(number, exc)
