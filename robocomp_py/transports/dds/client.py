"""Who commands and who calls."""

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
from .link import KEEP_ALL, Link, endpoint_qos, enter
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
    from .transport import DDSTransport


_FINE, _OK = Status.OK, int(Status.OK)
"""The status, and a plain number: finding the one in its class, and comparing with it, takes several times as long."""

DISCOVERED = 2.5
"""Seconds in which DDS tells that a server of this host has left, also if the machine is busy."""


class Line:
    """The way to the server of one channel: a writer of requests and, for queries, a reader of replies."""

    def __init__(self, link: AskingLink, name: str) -> None:
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
        """Whether requests arrive there, and replies here."""
        return server.handle in self.requests.matched() and (self.replies is None or bool(self.replies.matched()))

    def close(self) -> None:
        self.requests.close()
        if self.replies:
            self.replies.close()


def partition_of(client: int) -> str:
    return f"{client:016x}"


def client_of(partition: str) -> tuple[int, str]:
    """Whose partition it is; nobody's is 0."""
    return int(partition, 16) if re.fullmatch("[0-9a-f]{16}", partition) else 0, partition


class AskingLink(Link):
    """A link that finds the one process that serves its channel."""

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._message = Message(channel.type.request)
        self._fingerprint = channel.type.fingerprint
        self._lines: dict[str, Line] = {}
        self._found: tuple[Endpoint, Line] | None = None

    def open(self) -> None:
        if ANY not in self.channel.name:
            self._connect(self.channel.name)

    def looked(self, there: list[Endpoint]) -> None:
        if self._found and self._found[0] not in there:
            self._found = None
            self.lost()
        if ANY not in self.channel.name:
            return
        names = {endpoint.channel for endpoint in there}
        for name in self._lines.keys() - names:
            self._disconnect(self._lines.pop(name))
        for name in names - self._lines.keys():
            self._connect(name)

    def visible(self) -> bool:
        if self._found:
            return True
        for endpoint in self.counterparts(strict=True):
            line = self._lines.get(endpoint.channel)
            if line and line.reaches(endpoint):
                with self._looking:
                    if self.bus.endpoints.there(endpoint) and self._lines.get(line.name) is line:
                        self._found = endpoint, line
                        return True
        return False

    def server(self, end: float) -> tuple[Endpoint, Line]:
        """Who serves this channel, and the way there. Raises Unreachable if nobody does."""
        self.check_open()
        while True:
            found = self._found
            if found:
                return found
            self._news.clear()
            if not self.visible():
                if not self.counterparts(strict=True) or monotonic() >= end:
                    raise Unreachable(f"{self.channel.name}: no server")
                about_to_block()
                self.await_news(end)  # it is there, and discovery not quite finished
            self.check_open()

    def lost(self) -> None:
        """The server left."""

    def lose(self) -> None:
        super().lose()
        self._found = None

    def release(self) -> None:
        self._found = None
        for line in self._lines.values():
            self._disconnect(line)

    def _connect(self, name: str) -> None:
        self._lines[name] = Line(self, name)

    def _disconnect(self, line: Line) -> None:
        line.close()

    def write(self, line: Line, payload: Payload, flags: int, number: int, end: float) -> bool:
        """Send a request, trying until `end`; whether it was sent."""
        message = self._message
        sample = payload if message.plain and type(payload) is bytearray else message.sample(payload)
        left = (end - monotonic()) * 1000
        ms = int(left) if 0 < left < NO_DEADLINE else NO_DEADLINE if left > 0 else 0
        try:
            if len(sample) < LARGE:  # several threads may send one payload at once, and a copy is quicker than a lock
                sample = sample[:BEFORE_TAIL]
                fill_request(sample, 0, START, flags, ms, self._fingerprint, self.id, number, time_ns())
                return line.write(sample) or line.requests.write_within(sample, end, self._pause)
            with line.order:
                fill_request(sample, 0, START, flags, ms, self._fingerprint, self.id, number, time_ns())
                if line.write(memoryview(sample)[:BEFORE_TAIL]):
                    return True
                sample = sample[:BEFORE_TAIL]
            return line.requests.write_within(sample, end, self._pause)
        except TransportError:
            self.check_open()
            raise

    def _pause(self) -> None:
        self.check_open()
        if self._found is None:
            raise Unreachable(f"{self.channel.name}: its server left")
        about_to_block()


class CommandOutlet(AskingLink):
    role, facing = "commands", "receives"

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._order = threading.Lock()
        self._sent = 0
        self._claimed: Endpoint | None = None
        """The server whose claim was seen in our run-time folder."""

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = monotonic() + deadline
        enter(self, self._order, deadline)
        try:
            found = self.server(end)
            self._check_that_it_stays(found, end)
            line = found[1]
            if not self.write(line, payload, Flag.ONEWAY, self._sent + 1, end):
                raise Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")
            self._sent += 1
        finally:
            self._order.release()

    def _check_that_it_stays(self, found: tuple[Endpoint, Line], end: float) -> None:
        """Raise Unreachable if the server gave back its claim, which is seen sooner than DDS tells that it left."""
        server = found[0]
        if is_claimed(self.transport.folder, server.channel):
            self._claimed = server
            return
        if self._claimed is not server:  # on another host, or of another user: its claim is not here
            return
        patience = min(end, monotonic() + DISCOVERED)
        while self._found is found:
            if monotonic() >= patience:  # it is there: its claim was removed by somebody else
                self._claimed = None
                return
            about_to_block()
            self.closed.wait(0.002)
        self.check_open()
        raise Unreachable(f"{self.channel.name}: its server left")


class _Asker:
    """A synchronous call that waits. `woken` gets an item when another thread has news for it."""

    reply: Reply | None = None
    error: type[TransportError] | None = None
    woken: queue.SimpleQueue[None] | None = None


class Caller(AskingLink, SupportsQuestion):
    """Who waits for a reply receives it itself, and those of others that come meanwhile.

    Of several threads that wait, one has the turn and receives; when it leaves, another one is woken
    to take it. If none waits, but there are Futures, the crew attends to the replies. Should two
    receive for a moment, each sample goes to one of them, and both know whom it is for.
    """

    role, facing = "calls", "serves"

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._response = Message(channel.type.response)
        self._flags = Flag.IDEMPOTENT if channel.idempotent else Flag.NONE
        self._numbers = itertools.count(1)
        self._pending = Pending(channel.name)
        self._askers: dict[int, _Asker] = {}
        self._turn = [True]
        """Empty while an asker receives: operations on a list are atomic, and quicker than a lock."""
        self._switching = threading.Lock()
        self._crew_receives = self._asynchronous = False
        self._waiting = self.bus.waiting()

    def question(self, payload: Payload) -> Numbered:
        """What is asked under one number, however often."""
        return Numbered(self, payload, next(self._numbers))

    def call(self, payload: Payload, deadline: float, number: int = 0) -> Future[Reply]:
        end = monotonic() + deadline
        found = self.server(end)
        number = number or next(self._numbers)
        future = self._pending.add(number, deadline, end)  # to find the server may have taken a while
        try:
            self._still(found)
            if not self.write(found[1], payload, self._flags, number, end):
                self._pending.fail(number, Timeout(f"{self.channel.name}: could not be asked within {deadline:g} s"))
        except BaseException:
            future.cancel()
            raise
        self._asynchronous = True  # before looking: an asker that leaves gives back its turn and then looks at this
        if self._turn:
            self._have_crew_receive()
        self.bus.loop.due(end)
        return future

    def ask(self, payload: Payload, deadline: float, number: int = 0) -> Reply:
        end = monotonic() + deadline
        found = self._found or self.server(end)
        number, asker = number or next(self._numbers), _Asker()
        self._askers[number] = asker
        try:
            if self._found is not found:
                self._still(found)
            if not self.write(found[1], payload, self._flags, number, end):
                raise Timeout(f"{self.channel.name}: could not be asked within {deadline:g} s")
            del payload  # a large one makes room for the reply, which then takes no new pages from the system
            reply = self._await(asker, end)
        finally:
            del self._askers[number]
        if reply is None:
            raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s")
        return reply if reply[0] is _FINE else self._understood(reply)

    def tick(self) -> float | None:
        return self._pending.expire(self.bus.loop.do)

    def lost(self) -> None:
        for line in self._lines.values():
            self._take(line)  # what it answered before it left
        self._pending.fail_all(Unreachable(self._reason(Unreachable)), do=self.bus.loop.do)
        self._release_askers(Unreachable)

    def release(self) -> None:
        self._found = None  # first: who asks from now on is not among those who are told
        self._pending.close(Closed(self._reason(Closed)))
        self._release_askers(Closed)
        self._stop_crew()
        super().release()
        self._waiting.close()

    def _connect(self, name: str) -> None:
        super()._connect(name)
        replies = self._lines[name].replies
        assert replies
        self._waiting.attach(replies.condition)
        if self._crew_receives:
            self.bus.loop.attach(replies.condition, partial(self._on_reply, self._lines[name]))

    def _disconnect(self, line: Line) -> None:
        assert line.replies
        self._waiting.detach(line.replies.condition)
        self.bus.loop.detach(line.replies.condition)
        super()._disconnect(line)

    def _still(self, found: tuple[Endpoint, Line]) -> None:
        """Raise if the server left before we were among those who are told."""
        if self._found is not found:
            self.check_open()
            raise Unreachable(self._reason(Unreachable))

    def _release_askers(self, why: type[TransportError]) -> None:
        for asker in list(self._askers.values()):
            asker.error = why
            if asker.woken:
                asker.woken.put(None)
        self._waiting.wake()

    def _reason(self, why: type[TransportError]) -> str:
        return f"{self.channel.name}: {'the link is closed' if why is Closed else 'its server left'}"

    def _await(self, asker: _Asker, end: float) -> Reply | None:
        """The reply, or None if there is none in time."""
        waiting, receives = self._waiting, self._takes_turn(asker)
        try:
            while asker.reply is None:
                if asker.error:
                    raise asker.error(self._reason(asker.error))
                left = end - monotonic()
                if left <= 0:
                    return None
                if receives:
                    if waiting.wait(left):
                        for line in (*self._lines.values(),):
                            self._take(line)
                else:
                    assert asker.woken
                    with contextlib.suppress(queue.Empty):
                        asker.woken.get(timeout=left)
                    receives = self._takes_turn(asker)
            return asker.reply
        finally:
            if receives:
                self._turn.append(True)
            if self._asynchronous or len(self._askers) > 1:
                self._pass_turn(asker)

    def _takes_turn(self, asker: _Asker) -> bool:
        """Whether this one receives, until it gives back its turn; if not, it will be woken when another one does."""
        try:
            self._turn.pop()
        except IndexError:
            if asker.woken:
                return False
            asker.woken = queue.SimpleQueue()
            return self._takes_turn(asker)  # who left before this could be seen has woken somebody else
        if self._crew_receives:
            self._stop_crew()
        return True

    def _pass_turn(self, leaving: _Asker) -> None:
        """Have another one receive, unless one does."""
        for other in tuple(self._askers.values()):
            if not self._turn:
                return
            if other is not leaving and other.woken and other.reply is None and other.error is None:
                other.woken.put(None)
                return
        if self._asynchronous and self._turn and len(self._pending):
            self._have_crew_receive()

    def _have_crew_receive(self) -> None:
        with self._switching:
            if self._crew_receives or self.closed.is_set():
                return
            self._crew_receives = True
            for line in self._lines.values():
                assert line.replies
                self.bus.loop.attach(line.replies.condition, partial(self._on_reply, line))

    def _stop_crew(self) -> None:
        with self._switching:
            if not self._crew_receives:
                return
            self._crew_receives = False
            for line in self._lines.values():
                assert line.replies
                self.bus.loop.detach(line.replies.condition)

    def _on_reply(self, line: Line) -> list[Job]:
        self._take(line)
        if not self._turn:
            self._waiting.wake()  # it may have been the reply of who receives
        return []

    def _take(self, line: Line) -> None:
        assert line.replies
        response, mine = self._response, self.id
        for sample, info in line.replies.take(BATCH):
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
                        payload = sample[:BEFORE_TAIL]  # a small copy is made sooner than a view
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
            asker = self._askers.get(number)
            if asker is None:
                self.bus.loop.do(partial(self._settle, number, reply))  # its callbacks may take long, or ask again
                continue
            asker.reply = reply
            if asker.woken:
                asker.woken.put(None)

    def _settle(self, number: int, reply: Reply) -> None:
        try:
            self._pending.settle(number, self._understood(reply))
        except ContractMismatch as exc:
            self._pending.fail(number, exc)

    def _understood(self, reply: Reply) -> Reply:
        if reply.status is Status.MISMATCH and reply.payload:
            reply = reply._replace(payload=bare(reply.payload))
        return accepted(self.channel, reply)
