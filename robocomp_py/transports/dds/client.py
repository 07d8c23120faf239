"""The client's links: a command outlet and a caller."""

from __future__ import annotations

import contextlib
import itertools
import queue
import re
import struct
import threading
from concurrent.futures import Future
from functools import partial
from time import monotonic, time_ns
from typing import TYPE_CHECKING

from ...contract.interface import Pattern
from ...errors import (
    Closed,
    ContractMismatch,
    DecodeError,
    Timeout,
    TransportError,
    Unreachable,
)
from ...wire.codec import Payload
from ...wire.header import NO_DEADLINE, Flag
from ...wire.names import ANY
from ..base import (
    STATUSES,
    Channel,
    Reply,
    Status,
    SupportsQuestion,
    about_to_block,
    answered,
)
from ..exclusive import is_claimed
from ..leader_followers import Job
from ..limits import BATCH
from ..link import accepted
from ..pending import Pending
from ..replies import Numbered
from .bus import Reader
from .endpoints import Endpoint
from .library import LARGE
from .link import Link, enter
from .qos import KEEP_ALL, endpoint_qos
from .types import (
    BEFORE_TAIL,
    START,
    Message,
    bare,
    fill_request,
    reply_fields,
    reply_type,
    request_type,
    unreadable,
)

if TYPE_CHECKING:
    from .core import DDSCore


_FINE, _OK = Status.OK, int(Status.OK)
"""The status OK, and its number: attribute access and comparison of the enumeration are several times slower."""

DISCOVERED = 2.5
"""Seconds in which DDS reports that a server of this host has left, even if the machine is busy."""


class Connection:
    """Connects to the server of one channel: a writer of requests and, for queries, a reader of replies."""

    def __init__(self, link: ClientLink, name: str) -> None:
        kind, bus = link.channel.type, link.bus
        self.name = name
        self.order = threading.Lock()
        self.replies: Reader | None = None
        if link.channel.pattern is Pattern.QUERY:
            about = link.about("hears", name)
            made = reply_type(kind.response.name if kind.response else kind.name, kind.response)
            self.replies = bus.reader(f"rc/{name}Reply", made, endpoint_qos(KEEP_ALL, about), partition_of(link.id))
        about = link.about(channel=name)
        self.requests = bus.writer(
            f"rc/{name}Request", request_type(kind.name, kind.request), endpoint_qos(KEEP_ALL, about)
        )
        self.write = self.requests.write

    def reaches(self, server: Endpoint) -> bool:
        """Whether DDS has connected us with that server, in both directions."""
        return server.handle in self.requests.matched() and (self.replies is None or bool(self.replies.matched()))

    def close(self) -> None:
        self.requests.close()
        if self.replies:
            self.replies.close()


def partition_of(client: int) -> str:
    return f"{client:016x}"


def client_of(partition: str) -> tuple[int, str]:
    """The client of a partition, 0 if it is not a client's; and the partition."""
    return int(partition, 16) if re.fullmatch("[0-9a-f]{16}", partition) else 0, partition


class ClientLink(Link):
    """A link that finds the server of its channel."""

    def __init__(self, transport: DDSCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._message = Message(channel.type.request)
        self._fingerprint = channel.type.fingerprint
        self._connections: dict[str, Connection] = {}
        self._server: tuple[Endpoint, Connection] | None = None

    def open(self) -> None:
        if ANY not in self.channel.name:
            self._connect(self.channel.name)

    def peers_changed(self, there: list[Endpoint]) -> None:
        if self._server and self._server[0] not in there:
            self._server = None
            self.server_left()
        if ANY not in self.channel.name:
            return
        names = {endpoint.channel for endpoint in there}
        for name in self._connections.keys() - names:
            self._disconnect(self._connections.pop(name))
        for name in names - self._connections.keys():
            self._connect(name)

    def visible(self) -> bool:
        if self._server:
            return True
        for endpoint in self.counterparts(strict=True):
            connection = self._connections.get(endpoint.channel)
            if connection and connection.reaches(endpoint):
                with self._looking:
                    if self.bus.endpoints.there(endpoint) and self._connections.get(connection.name) is connection:
                        self._server = endpoint, connection
                        return True
        return False

    def server(self, end: float) -> tuple[Endpoint, Connection]:
        """The server of this channel, and the connection to it. Raises Unreachable if there is none."""
        self.check_open()
        while True:
            found = self._server
            if found:
                return found
            self._news.clear()
            if not self.visible():
                if not self.counterparts(strict=True) or monotonic() >= end:
                    raise Unreachable(f"{self.channel.name}: no server")
                about_to_block()
                self.await_news(end)  # the server exists; DDS has not connected us yet
            self.check_open()

    def server_left(self) -> None:
        """The server left."""

    def lose(self) -> None:
        super().lose()
        self._server = None

    def release(self) -> None:
        self._server = None
        for connection in tuple(self._connections.values()):
            self._disconnect(connection)

    def _connect(self, name: str) -> None:
        self._connections[name] = Connection(self, name)

    def _disconnect(self, connection: Connection) -> None:
        connection.close()

    def write(self, connection: Connection, payload: Payload, flags: int, number: int, end: float) -> bool:
        """Send a request, with retries until `end`; False if there was no room."""
        message = self._message
        sample = payload if message.plain and type(payload) is bytearray else message.sample(payload)
        left = (end - monotonic()) * 1000
        ms = int(left) if 0 < left < NO_DEADLINE else NO_DEADLINE if left > 0 else 0
        try:
            if len(sample) < LARGE:  # a copy is faster than a lock against other threads that send the same payload
                sample = sample[:BEFORE_TAIL]
                fill_request(sample, 0, START, flags, ms, self._fingerprint, self.id, number, time_ns())
                return connection.write(sample) or connection.requests.write_within(sample, end, self._pause)
            with connection.order:
                fill_request(sample, 0, START, flags, ms, self._fingerprint, self.id, number, time_ns())
                if connection.write(memoryview(sample)[:BEFORE_TAIL]):
                    return True
                sample = sample[:BEFORE_TAIL]
            return connection.requests.write_within(sample, end, self._pause)
        except TransportError:
            self.check_open()
            raise

    def _pause(self) -> None:
        self.check_open()
        if self._server is None:
            raise Unreachable(f"{self.channel.name}: its server left")
        about_to_block()


class CommandOutlet(ClientLink):
    role, facing = "commands", "receives"

    def __init__(self, transport: DDSCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._order = threading.Lock()
        self._sent = 0
        self._claimed: Endpoint | None = None
        """The server whose claim we have seen in our run-time folder."""

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = monotonic() + deadline
        enter(self, self._order, deadline)
        try:
            found = self.server(end)
            self._check_claim(found, end)
            connection = found[1]
            if not self.write(connection, payload, Flag.ONEWAY, self._sent + 1, end):
                raise Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")
            self._sent += 1
        finally:
            self._order.release()

    def _check_claim(self, found: tuple[Endpoint, Connection], end: float) -> None:
        """Raise Unreachable if the server released its claim, which happens before DDS reports that it left."""
        server = found[0]
        if is_claimed(self.transport.folder, server.channel):
            self._claimed = server
            return
        if self._claimed is not server:  # on another host, or of another user: its claim is not here
            return
        give_up = min(end, monotonic() + DISCOVERED)
        while self._server is found:
            if monotonic() >= give_up:  # it exists: another program removed its claim
                self._claimed = None
                return
            about_to_block()
            self.closed.wait(0.002)
        self.check_open()
        raise Unreachable(f"{self.channel.name}: its server left")


class _BlockingCall:
    """A blocking call that waits. Another thread puts an item into `woken` when it has news for the call."""

    reply: Reply | None = None
    error: type[TransportError] | None = None
    woken: queue.SimpleQueue[None] | None = None


class Caller(ClientLink, SupportsQuestion):
    """A thread that waits for a reply receives it itself, and also the replies to other threads.

    Of several waiting threads, one has the turn and receives; when it leaves, it wakes another one. If
    none waits, but there are Futures, the loop receives. Two may receive for a moment: each sample goes
    to one of them, which passes it to its call.
    """

    role, facing = "calls", "serves"

    def __init__(self, transport: DDSCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._response = Message(channel.type.response)
        self._flags = Flag.IDEMPOTENT if channel.idempotent else Flag.NONE
        self._numbers = itertools.count(1)
        self._pending = Pending(channel.name)
        self._calls: dict[int, _BlockingCall] = {}
        self._turn = [True]
        """Empty while a blocking call receives. List operations are atomic, and faster than a lock."""
        self._switching = threading.Lock()
        self._loop_receives = self._asynchronous = False
        self._waiting = self.bus.waiting()

    def question(self, payload: Payload) -> Numbered:
        """A request that keeps its number over all retries."""
        return Numbered(self, payload, next(self._numbers))

    def call(self, payload: Payload, deadline: float, number: int = 0) -> Future[Reply]:
        end = monotonic() + deadline
        found = self.server(end)
        number = number or next(self._numbers)
        future = self._pending.add(number, deadline, end)  # finding the server may have taken a while
        try:
            self._check_server(found)
            if not self.write(found[1], payload, self._flags, number, end):
                self._pending.fail(
                    number, Timeout(f"{self.channel.name}: could not send the request within {deadline:g} s")
                )
        except BaseException:
            future.cancel()
            raise
        self._asynchronous = True  # before the check: a call that ends gives back the turn, then reads this
        if self._turn:
            self._start_loop()
        self.bus.loop.due(end)
        return future

    def ask(self, payload: Payload, deadline: float, number: int = 0) -> Reply:
        end = monotonic() + deadline
        found = self._server or self.server(end)
        number, call = number or next(self._numbers), _BlockingCall()
        self._calls[number] = call
        try:
            if self._server is not found:
                self._check_server(found)
            if not self.write(found[1], payload, self._flags, number, end):
                raise Timeout(f"{self.channel.name}: could not send the request within {deadline:g} s")
            del payload  # the reply may reuse its memory
            reply = self._await(call, end)
        finally:
            del self._calls[number]
        if reply is None:
            raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s")
        return reply if reply[0] is _FINE else self._decoded(reply)

    def tick(self) -> float | None:
        return self._pending.expire(self.bus.loop.do)

    def server_left(self) -> None:
        for connection in tuple(self._connections.values()):
            self._take(connection)  # replies that it sent before it left
        self._pending.fail_all(Unreachable(self._reason(Unreachable)), do=self.bus.loop.do)
        self._release_calls(Unreachable)

    def release(self) -> None:
        self._server = None  # first: later calls find no server
        self._pending.close(Closed(self._reason(Closed)))
        self._release_calls(Closed)
        self._stop_loop()
        super().release()
        self._waiting.close()

    def _connect(self, name: str) -> None:
        super()._connect(name)
        replies = self._connections[name].replies
        assert replies
        self._waiting.attach(replies.condition)
        if self._loop_receives:
            self.bus.loop.attach(replies.condition, partial(self._on_reply, self._connections[name]))

    def _disconnect(self, connection: Connection) -> None:
        assert connection.replies
        self._waiting.detach(connection.replies.condition)
        self.bus.loop.detach(connection.replies.condition)
        super()._disconnect(connection)

    def _check_server(self, found: tuple[Endpoint, Connection]) -> None:
        """Raise if the server left before our call was registered."""
        if self._server is not found:
            self.check_open()
            raise Unreachable(self._reason(Unreachable))

    def _release_calls(self, why: type[TransportError]) -> None:
        for call in list(self._calls.values()):
            call.error = why
            if call.woken:
                call.woken.put(None)
        self._waiting.wake()

    def _reason(self, why: type[TransportError]) -> str:
        return f"{self.channel.name}: {'the link is closed' if why is Closed else 'its server left'}"

    def _await(self, call: _BlockingCall, end: float) -> Reply | None:
        """Wait for the reply; None at `end`."""
        waiting, receives = self._waiting, self._takes_turn(call)
        try:
            while call.reply is None:
                if call.error:
                    raise call.error(self._reason(call.error))
                left = end - monotonic()
                if left <= 0:
                    return None
                if receives:
                    if waiting.wait(left):
                        for connection in (*self._connections.values(),):
                            self._take(connection)
                else:
                    assert call.woken
                    with contextlib.suppress(queue.Empty):
                        call.woken.get(timeout=left)
                    receives = self._takes_turn(call)
            return call.reply
        finally:
            if receives:
                self._turn.append(True)
            if self._asynchronous or len(self._calls) > 1:
                self._pass_turn(call)

    def _takes_turn(self, call: _BlockingCall) -> bool:
        """Take the turn to receive; False if another call has it, which wakes this one when it leaves."""
        try:
            self._turn.pop()
        except IndexError:
            if call.woken:
                return False
            call.woken = queue.SimpleQueue()
            return self._takes_turn(call)  # a call that left before could not see `woken`
        if self._loop_receives:
            self._stop_loop()
        return True

    def _pass_turn(self, leaving: _BlockingCall) -> None:
        """Have another blocking call, or the loop, receive, unless a call has the turn."""
        for other in tuple(self._calls.values()):
            if not self._turn:
                return
            if other is not leaving and other.woken and other.reply is None and other.error is None:
                other.woken.put(None)
                return
        if self._asynchronous and self._turn and len(self._pending):
            self._start_loop()

    def _start_loop(self) -> None:
        with self._switching:
            if self._loop_receives or self.closed.is_set():
                return
            self._loop_receives = True
            for connection in tuple(self._connections.values()):
                assert connection.replies
                self.bus.loop.attach(connection.replies.condition, partial(self._on_reply, connection))

    def _stop_loop(self) -> None:
        with self._switching:
            if not self._loop_receives:
                return
            self._loop_receives = False
            for connection in tuple(self._connections.values()):
                assert connection.replies
                self.bus.loop.detach(connection.replies.condition)

    def _on_reply(self, connection: Connection) -> list[Job]:
        self._take(connection)
        if not self._turn:
            self._waiting.wake()  # the reply may be that of the call that has the turn
        return []

    def _take(self, connection: Connection) -> None:
        assert connection.replies
        response, mine = self._response, self.id
        for sample, info in connection.replies.take(BATCH):
            if not info.valid_data:
                continue
            try:
                start, status, client, number, _, _ = reply_fields(sample)
                if start != START:
                    raise unreadable(sample)
                if status == _OK:
                    if not response.plain:
                        payload = response.payload(sample)
                    elif len(sample) < LARGE:
                        payload = sample[:BEFORE_TAIL]  # a small copy is faster than a view
                    else:
                        payload = memoryview(sample)[:BEFORE_TAIL]
                    reply = answered((_FINE, payload))
                else:
                    reply = Reply(STATUSES[status], response.why(sample))
            except (DecodeError, KeyError, struct.error) as exc:
                self.malformed(exc)
                continue
            if client != mine:
                continue
            call = self._calls.get(number)
            if call is None:
                self.bus.loop.do(partial(self._settle, number, reply))  # its callbacks may take long, or call again
                continue
            call.reply = reply
            if call.woken:
                call.woken.put(None)

    def _settle(self, number: int, reply: Reply) -> None:
        try:
            self._pending.settle(number, self._decoded(reply))
        except ContractMismatch as exc:
            self._pending.fail(number, exc)

    def _decoded(self, reply: Reply) -> Reply:
        if reply.status is Status.MISMATCH and reply.payload:
            reply = reply._replace(payload=bare(reply.payload))
        return accepted(self.channel, reply)
