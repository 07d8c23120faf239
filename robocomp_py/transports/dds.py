"""Transport `dds`: Cyclone DDS; other vendors' tools see our topics, types and fields.

    rc/<channel>            publications, 1:n
    rc/<channel>Credit      how far the readers of a reliable topic are, to its publisher
    rc/<channel>Request     commands and requests, n:1
    rc/<channel>Reply       replies; every client has a partition of its own, and the server a writer in it

Who is there is told by the endpoints themselves: each carries its role and contract as USER_DATA
(`dds_bus.Endpoints`). DDS itself acknowledges a sample when it has arrived, not when it was read,
and a reader without room would stop all others of its process; so a reliable topic counts: its
publisher sends no more than its readers have said they take (`Credit`).

Threads. The leader of a `Crew` waits for all readers and runs sinks and services itself. A
synchronous call waits for its reply on its own thread (`_Desk`).
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import queue
import threading
import time
from collections.abc import Iterable
from concurrent.futures import Future
from functools import partial
from typing import Any, TypeVar

from cyclonedds.core import Policy, Qos

from ..contract.interface import Pattern
from ..contract.qos import History
from ..errors import Closed, ConfigurationError, ContractMismatch, DecodeError, Timeout, TransportError, Unreachable
from ..wire.codec import Codec, Payload
from ..wire.header import NO_DEADLINE, Flag, random_id
from ..wire.names import ANY
from .base import (
    Capability,
    Channel,
    Reply,
    Service,
    Sink,
    Statistics,
    Status,
    TransportConfig,
    TypeRef,
    mismatch,
    options_of,
    serve,
    step_aside,
)
from .crew import Crew, Gate, Job, Lane
from .dds_bus import BLOCKING_MS, Bus, Endpoint, Reader, Writer, user_data
from .dds_types import (
    CODEC,
    Credit,
    Message,
    Request,
    bare,
    credit_type,
    dressed,
    fill_publication,
    fill_reply,
    fill_request,
    pack_credit,
    publication_type,
    read_credit,
    read_publication,
    read_reply,
    read_request,
    reply_type,
    request_type,
)
from .directory import runtime_dir
from .exclusive import Claim, claim
from .ledger import Ledger
from .pending import Pending

log = logging.getLogger("robocomp.transport.dds")

BATCH = 32
"""Messages taken from one reader before the others have their turn."""

KEEP_ALL_DEPTH = 10_000
COMMANDS_WAITING = 1000

UNGREETED = 100
"""Messages that a subscriber gets before it has said how many it takes."""

SOON = 0.02
"""Seconds until the next look at what discovery has not finished."""

PATIENCE = 60.0
"""Seconds for which a reply without deadline is kept for a client that cannot be reached yet."""

L = TypeVar("L", bound="_Link")


class DDSTransport:
    """Options `domain` (0) and `interface` ("lo", this host alone; "" lets Cyclone DDS choose)."""

    def __init__(self, config: TransportConfig) -> None:
        options = options_of(config, domain=0, interface="lo")
        domain, interface = options["domain"], options["interface"]
        if type(domain) is not int or not 0 <= domain <= 230:
            raise ConfigurationError(f"transport option `domain` is a number from 0 to 230, not {domain!r}")
        if type(interface) is not str:
            raise ConfigurationError(f"transport option `interface` is a name like 'lo', not {interface!r}")
        self.capabilities = Capability.RELIABLE | Capability.LATCHED | Capability.CROSS_PROCESS
        if interface != "lo":
            self.capabilities |= Capability.CROSS_HOST
        self.codec: Codec = CODEC
        self.owner = config.owner
        self.incarnation = random_id()
        self.folder = runtime_dir() / "dds"
        self.closed = False
        self._lock = threading.RLock()
        self._links: list[_Link] = []
        self._ids: set[int] = set()
        self.bus = Bus(domain, interface)
        self.bus.endpoints.on_change = self._look
        self.bus.loop.tick = self._tick
        self._crew = Crew("dds", self._receive, self.bus.loop.wake)
        self._crew.start()

    def outlet(self, channel: Channel) -> _Publisher | _CommandOutlet:
        kind = _Publisher if channel.pattern is Pattern.PUBLISH else _CommandOutlet
        return self._open(kind(self, channel))

    def inlet(self, channel: Channel, sink: Sink) -> _Subscriber | _CommandInlet:
        kind = _Subscriber if channel.pattern is Pattern.PUBLISH else _CommandInlet
        return self._open(kind(self, channel, sink))

    def caller(self, channel: Channel) -> _Caller:
        return self._open(_Caller(self, channel))

    def server(self, channel: Channel, service: Service) -> _Server:
        return self._open(_Server(self, channel, service))

    def close(self) -> None:
        with self._lock:
            if self.closed:
                return
            self.closed = True
        for link in reversed(list(self._links)):
            link.close()
        self._crew.close()
        self.bus.close()

    def new_id(self) -> int:
        """A number for a link of ours."""
        number = random_id()
        self._ids.add(number)
        return number

    def owns(self, link: int) -> bool:
        """Whether a link of that number is one of ours."""
        return link in self._ids

    def left(self, link: _Link) -> None:
        with self._lock:
            self._ids.discard(link.id)
            if link in self._links:
                self._links.remove(link)

    def _open(self, link: L) -> L:
        if self.closed:
            raise Closed("the transport is closed")
        try:
            link.open()
            with self._lock:
                self._links.append(link)
            link.look()  # at those who were there before; those who come now are reported to all in the list
        except BaseException:
            link.close()
            raise
        if self.closed:
            link.close()
            raise Closed("the transport is closed")
        return link

    # On the receiving thread, which must go on whatever happens.

    def _receive(self) -> Iterable[Job]:
        try:
            return self.bus.loop.receive()
        except Exception:
            log.exception("receiving")
            return ()

    def _look(self) -> None:
        for link in list(self._links):
            with self._guarded(link):
                link.look()

    def _tick(self) -> float:
        due = float("inf")
        for link in list(self._links):
            with self._guarded(link):
                due = min(due, link.tick())
        return due

    @contextlib.contextmanager
    def _guarded(self, link: _Link) -> Any:
        try:
            yield
        except Exception:
            if not link.closed.is_set():
                log.exception("%s: looking at who is there", link.channel.name)


def _qos(history: Any, *more: Any) -> Qos:
    """What all our endpoints have in common.

    All are reliable on the wire, since a large sample loses fragments even on one host. Samples are
    ordered as they arrive, for clocks may be set back.
    """
    return Qos(
        Policy.Reliability.Reliable(BLOCKING_MS * 1_000_000),
        history,
        Policy.DestinationOrder.ByReceptionTimestamp,
        Policy.DataRepresentation(use_cdrv0_representation=True),
        *more,
    )


def _topic_qos(channel: Channel, *more: Any) -> Qos:
    qos = channel.qos
    newest = Policy.History.KeepLast(max(_depth(channel), 8))  # for a moment: what waits for a sink is the lane's
    if not qos.latched:
        return _qos(Policy.History.KeepAll if qos.reliable else newest, *more)
    unlimited = -1
    return _qos(
        Policy.History.KeepAll if qos.reliable else newest,
        Policy.Durability.TransientLocal,
        Policy.DurabilityService(0, Policy.History.KeepLast(qos.depth), unlimited, unlimited, unlimited),
        *more,
    )


def _depth(channel: Channel) -> int:
    return KEEP_ALL_DEPTH if channel.qos.history is History.KEEP_ALL else channel.qos.depth


_KEEP_ALL = Policy.History.KeepAll


def whole(sample: bytearray | memoryview) -> bytearray:
    """The buffer of a sample, without its tail or with it: where its header is filled in."""
    return sample.obj if type(sample) is memoryview else sample  # type: ignore[return-value]  # of a bytearray


class _Link:
    """One end of a channel. `facing` is the role of the other."""

    role: str
    facing: str

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        self.transport, self.channel = transport, channel
        self.bus = transport.bus
        self.stats = Statistics()
        self.closed = threading.Event()
        self.id = transport.new_id()
        self._closing = threading.Lock()
        self._looking = threading.RLock()
        self._reported: set[object] = set()

    def open(self) -> None:
        """Make what is needed."""

    def look(self) -> None:
        """Somebody came or went."""
        with self._looking:
            if not self.closed.is_set():
                self.looked(self.counterparts())

    def looked(self, there: list[Endpoint]) -> None:
        """`there` are those who face us and mean the same."""

    def tick(self) -> float:
        """Do what is due; the time of the next."""
        return float("inf")

    def wait_peer(self, timeout: float) -> bool:
        end = time.monotonic() + timeout
        while True:
            self.check_open()
            if self.visible():
                return True
            if time.monotonic() >= end:
                return False
            self.closed.wait(min(0.005, max(0.0, end - time.monotonic())))

    def visible(self) -> bool:
        """Whether the other side is there. Raises ContractMismatch if only others are."""
        return bool(self.counterparts(strict=True))

    def close(self) -> None:
        with self._closing:
            if self.closed.is_set():
                return
            self.closed.set()
        self.transport.left(self)
        with self._looking:  # so that nothing is made any more
            pass
        self.release()

    def release(self) -> None:
        """Let go of what this link holds; called once, when it is closed."""

    def about(self, role: str = "", channel: str = "") -> Policy.Userdata:
        kind = self.channel.type
        return user_data(
            role=role or self.role,
            channel=channel or self.channel.name,
            fingerprint=kind.fingerprint,
            text=kind.text,
            id=self.id,
            reliable=self.channel.qos.reliable,
            latched=self.channel.qos.latched,
            owner=self.transport.owner,
            pid=os.getpid(),
        )

    def counterparts(self, *, strict: bool = False) -> list[Endpoint]:
        """Those we face who mean the same by the name; the others are reported, once each.

        With `strict`, raises ContractMismatch if there are only others.
        """
        named = [
            endpoint
            for endpoint in self.bus.endpoints.find(self.facing, self.channel.name)
            if endpoint.channel == self.channel.name or not self.transport.owns(endpoint.id)
        ]
        mine = self.channel.type.fingerprint
        same = [endpoint for endpoint in named if endpoint.fingerprint == mine]
        for endpoint in named:
            if endpoint.fingerprint != mine:
                self.report_mismatch((endpoint.id, endpoint.fingerprint), _type_of(endpoint))
        if strict and named and not same:
            raise ContractMismatch(mismatch(self.channel, _type_of(named[0])))
        return same

    def check_open(self) -> None:
        if self.closed.is_set() or self.transport.closed:
            raise Closed(f"{self.channel.name}: the link is closed")

    def report_mismatch(self, who: object, other: TypeRef) -> None:
        if who not in self._reported:
            self._reported.add(who)
            log.error("%s", mismatch(self.channel, other))
            self.stats.mismatched += 1  # at last: who sees the count finds the reason in the log

    def malformed(self, why: object) -> None:
        """Count a message that is none of ours; the first one is logged."""
        self.stats.malformed += 1
        if self.stats.malformed == 1:
            log.warning("%s: dropped a malformed message (further ones are only counted): %s", self.channel.name, why)


def _type_of(endpoint: Endpoint) -> TypeRef:
    return TypeRef("", endpoint.fingerprint, endpoint.text)


# -- topics -------------------------------------------------------------------


class _Publisher(_Link):
    role, facing = "publishes", "subscribes"

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._message = Message(channel.type.request)
        self._order = threading.Lock()
        self._sent = 0
        self._writer: Writer | None = None
        self._credits: Reader | None = None
        self._room = threading.Condition()
        self._limits: dict[int, int] = {}
        """By reader that counts: the number of the last message it takes."""
        self._greeted: set[int] = set()
        self._early: dict[int, Credit] = {}

    def open(self) -> None:
        channel = self.channel
        kind = publication_type(channel.type.name, channel.type.request)
        self._writer = self.bus.writer(f"rc/{channel.name}", kind, _topic_qos(channel, self.about()))
        if channel.qos.reliable:
            about = self.about("credited")
            self._credits = self.bus.reader(f"rc/{channel.name}Credit", credit_type(), _qos(_KEEP_ALL, about))
            self.bus.loop.attach(self._credits.condition, self._on_credit)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        sample = self._message.sample(payload)
        with self._order:
            self.check_open()
            if self._credits and not self._await_credit(self._sent + 1, end):
                raise Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")
            fill_publication(whole(sample), self.channel.type.fingerprint, self.id, self._sent + 1, time.time_ns())
            if self._credits is None:
                self._sent += 1  # whether it gets away or not: who hears the next one knows what is missing
                self.stats.dropped += not self._written(sample)
            elif self._written_within(sample, end):
                self._sent += 1
            else:
                raise Timeout(f"{self.channel.name}: the network did not take a message for {deadline:g} s")

    def visible(self) -> bool:
        same = {endpoint.handle for endpoint in self.counterparts(strict=True)}
        named = {endpoint.handle for endpoint in self.bus.endpoints.find(self.facing, self.channel.name)}
        matched = self._writer.matched() if self._writer else set()
        return bool(matched - (named - same))  # others than ours can only be right

    def looked(self, there: list[Endpoint]) -> None:
        counting = {endpoint.id for endpoint in there if endpoint.reliable}
        with self._room:
            for reader in self._limits.keys() - counting:
                del self._limits[reader]
                self._greeted.discard(reader)
            for reader in counting - self._limits.keys():
                self._limits[reader] = self._sent + UNGREETED
                if reader in self._early:
                    self._grant(self._early[reader])
            self._early.clear()
            self._room.notify_all()

    def release(self) -> None:
        with self._room:
            self._room.notify_all()
        if self._credits:
            self.bus.loop.detach(self._credits.condition)
            self._credits.close()
        with self._order:
            if self._writer:
                self._writer.close()

    def _written(self, sample: bytearray | memoryview) -> bool:
        assert self._writer
        try:
            return self._writer.write(sample)
        except TransportError:
            self.check_open()
            raise

    def _written_within(self, sample: bytearray | memoryview, end: float) -> bool:
        assert self._writer
        return self._written(sample) or self._writer.write_within(sample, end, self._pause)

    def _pause(self) -> None:
        self.check_open()
        step_aside()

    def _await_credit(self, number: int, end: float) -> bool:
        """Wait until every reader takes a message of that number."""
        with self._room:
            if self._covers(number):
                return True
        step_aside()  # what we wait for may come in by this very thread
        with self._room:
            self._room.wait_for(lambda: self._covers(number) or self.closed.is_set(), max(0.0, end - time.monotonic()))
            self.check_open()
            return self._covers(number)

    def _covers(self, number: int) -> bool:
        return all(limit >= number for limit in self._limits.values())

    def _on_credit(self) -> list[Job]:
        assert self._credits
        for sample in self._credits.take(BATCH):
            try:
                credit = read_credit(sample)
            except DecodeError as exc:
                self.malformed(exc)
                continue
            if credit.source != self.id:
                continue
            with self._room:
                if credit.reader in self._limits:
                    self._grant(credit)
                elif len(self._early) < BATCH:
                    self._early[credit.reader] = credit  # its reader will be reported soon
        return []

    def _grant(self, credit: Credit) -> None:
        limit = credit.sequence + credit.window
        if credit.reader in self._greeted:
            limit = max(limit, self._limits[credit.reader])
        else:
            self._greeted.add(credit.reader)
            limit = max(limit, self._sent + credit.window)  # what was sent before it came is no debt of its
        self._limits[credit.reader] = limit
        self._room.notify_all()


class _Heard:
    """A topic that a subscriber hears: one, or with `*` all that are there."""

    def __init__(self, reader: Reader, credits: Writer | None) -> None:
        self.reader, self.credits = reader, credits
        self.paused = False
        self.consumed: dict[int, int] = {}
        self.told: dict[int, int] = {}
        """By source: up to which message we said that we have consumed."""

    def close(self) -> None:
        self.reader.close()
        if self.credits:
            self.credits.close()


class _Subscriber(_Link):
    role, facing = "subscribes", "publishes"

    def __init__(self, transport: DDSTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        reliable = channel.qos.reliable
        self._sink = sink
        self._window = _depth(channel)
        self._lane = Lane(
            channel.name,
            self._consume,
            max(self._window, COMMANDS_WAITING) if reliable else self._window,
            lossy=not reliable,
            stats=self.stats,
        )
        self._message = Message(channel.type.request)
        self._ledger = Ledger(self.stats, ordered=True)
        self._heard: dict[str, _Heard] = {}
        self._due = float("inf")

    def open(self) -> None:
        if ANY not in self.channel.name:
            self._hear(self.channel.name)

    def looked(self, there: list[Endpoint]) -> None:
        if ANY in self.channel.name:
            names = {endpoint.channel for endpoint in there}
            for name in self._heard.keys() - names:
                self._unhear(name)
            for name in names - self._heard.keys():
                self._hear(name)
        if self.channel.qos.reliable:
            self._greet()
        if self.channel.qos.latched:
            for endpoint in there:
                if not endpoint.latched and endpoint.id not in self._reported:
                    self._reported.add(endpoint.id)
                    log.error(
                        "%s: %s does not keep messages for late subscribers, as we ask: DDS does not connect us",
                        self.channel.name,
                        endpoint.owner,
                    )

    def tick(self) -> float:
        if time.monotonic() >= self._due:
            with self._looking:
                if not self.closed.is_set():
                    self._greet()
        return self._due

    def visible(self) -> bool:
        self.counterparts(strict=True)
        return any(heard.reader.matched() for heard in list(self._heard.values()))

    def release(self) -> None:
        self._lane.close()
        for name in list(self._heard):
            self._unhear(name)

    def _hear(self, name: str) -> None:
        kind = publication_type(self.channel.type.name, self.channel.type.request)
        credits = None
        if self.channel.qos.reliable:
            about = self.about("credits", name)
            credits = self.bus.writer(f"rc/{name}Credit", credit_type(), _qos(_KEEP_ALL, about))
        about = self.about("subscribes", name)
        heard = _Heard(self.bus.reader(f"rc/{name}", kind, _topic_qos(self.channel, about)), credits)
        self._heard[name] = heard
        self.bus.loop.attach(heard.reader.condition, partial(self._on_message, heard))

    def _unhear(self, name: str) -> None:
        heard = self._heard.pop(name)
        self.bus.loop.detach(heard.reader.condition)
        heard.close()

    def _on_message(self, heard: _Heard) -> list[Job]:
        taken = 0
        for _ in range(BATCH):
            if self._lane.full:
                heard.paused = True
                self.bus.loop.detach(heard.reader.condition)
                break
            samples = heard.reader.take(1 if self.channel.qos.reliable else BATCH)
            taken += sum(self._take(heard, sample) for sample in samples)
            if not samples or not self.channel.qos.reliable:
                break
        return [self._drain] if taken or heard.paused else []

    def _take(self, heard: _Heard, sample: bytes) -> bool:
        try:
            header = read_publication(sample)
            if header.fingerprint != self.channel.type.fingerprint:
                self.report_mismatch(header.source, TypeRef("", header.fingerprint))
                return False
            payload = self._message.payload(sample)
        except DecodeError as exc:
            self.malformed(exc)
            return False
        admitted = self._ledger.admit(header.source, header.sequence)
        return admitted and self._lane.put((heard, header.source, header.sequence, payload))

    def _drain(self) -> None:
        self._lane.drain()
        for heard in list(self._heard.values()):
            if heard.paused:
                heard.paused = False
                self.bus.loop.attach(heard.reader.condition, partial(self._on_message, heard))

    def _consume(self, message: tuple[_Heard, int, int, Payload]) -> None:
        heard, source, sequence, payload = message
        try:
            self._sink(payload)
        finally:
            if heard.credits:
                heard.consumed[source] = sequence
                if sequence - heard.told.get(source, sequence) >= max(1, self._window // 2):
                    self._tell(heard, source)

    def _greet(self) -> None:
        """Tell the publishers that we can reach, and have not told yet, how much we take."""
        self._due = float("inf")
        for name, heard in self._heard.items():
            assert heard.credits
            credited = self.bus.endpoints.find("credited", name)
            for gone in heard.told.keys() - {endpoint.id for endpoint in credited}:
                del heard.told[gone]
            waiting = [endpoint for endpoint in credited if endpoint.id not in heard.told]
            matched = heard.credits.matched() if waiting else set()
            for endpoint in waiting:
                if endpoint.handle in matched and endpoint.fingerprint == self.channel.type.fingerprint:
                    self._tell(heard, endpoint.id)
                else:
                    self._due = time.monotonic() + SOON
        self.bus.loop.due(self._due)

    def _tell(self, heard: _Heard, source: int) -> None:
        assert heard.credits
        consumed = heard.consumed.get(source, 0)
        heard.told[source] = consumed
        with contextlib.suppress(TransportError):  # closed meanwhile
            heard.credits.write(pack_credit(Credit(self.id, source, consumed, self._window)))


# -- commands and queries, the asking side ------------------------------------


class _Line:
    """The way to the server of one channel: a writer of requests and, for queries, a reader of replies."""

    def __init__(self, link: _AskingLink, name: str) -> None:
        kind, bus = link.channel.type, link.bus
        self.name = name
        self.order = threading.Lock()
        self.replies: Reader | None = None
        if link.channel.pattern is Pattern.QUERY:
            about = link.about("hears", name)
            made = reply_type(kind.response.name if kind.response else kind.name, kind.response)
            self.replies = bus.reader(f"rc/{name}Reply", made, _qos(_KEEP_ALL, about), _partition_of(link.id))
        about = link.about(channel=name)
        self.requests = bus.writer(f"rc/{name}Request", request_type(kind.name, kind.request), _qos(_KEEP_ALL, about))

    def reaches(self, server: Endpoint) -> bool:
        """Whether requests arrive there, and replies here."""
        return server.handle in self.requests.matched() and (self.replies is None or bool(self.replies.matched()))

    def close(self) -> None:
        self.requests.close()
        if self.replies:
            self.replies.close()


def _partition_of(client: int) -> str:
    return f"{client:016x}"


class _AskingLink(_Link):
    """A link that finds the one process that serves its channel."""

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._message = Message(channel.type.request)
        self._lines: dict[str, _Line] = {}
        self._found: tuple[Endpoint, _Line] | None = None

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

    def server(self, end: float) -> tuple[Endpoint, _Line]:
        """Who serves this channel, and the way there. Raises Unreachable if nobody does."""
        self.check_open()
        while True:
            found = self._found
            if found:
                return found
            if not self.visible():
                if not self.counterparts(strict=True) or time.monotonic() >= end:
                    raise Unreachable(f"{self.channel.name}: nobody serves it")
                step_aside()
                self.closed.wait(0.002)  # it is there, and discovery not quite finished
            self.check_open()

    def lost(self) -> None:
        """The server left."""

    def release(self) -> None:
        self._found = None
        for line in self._lines.values():
            self._disconnect(line)

    def _connect(self, name: str) -> None:
        self._lines[name] = _Line(self, name)

    def _disconnect(self, line: _Line) -> None:
        line.close()

    def write(self, line: _Line, payload: Payload, flags: int, number: int, end: float) -> bool:
        """Send a request, trying until `end`; whether it was sent."""
        sample = self._message.sample(payload)
        try:
            with line.order:  # a payload may be sent by several threads at once
                left = end - time.monotonic()
                fill_request(whole(sample), flags, left, self.channel.type.fingerprint, self.id, number, time.time_ns())
                if line.requests.write(sample):
                    return True
                sample = bytearray(sample)
            return line.requests.write_within(sample, end, self._pause)
        except TransportError:
            self.check_open()
            raise

    def _pause(self) -> None:
        self.check_open()
        if self._found is None:
            raise Unreachable(f"{self.channel.name}: its server left")
        step_aside()


class _CommandOutlet(_AskingLink):
    role, facing = "commands", "receives"

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._order = threading.Lock()
        self._sent = 0

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        with self._order:
            _, line = self.server(end)
            if not self.write(line, payload, Flag.ONEWAY, self._sent + 1, end):
                raise Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")
            self._sent += 1


_STATUSES = {status.value: status for status in Status}


class _Asker:
    """A synchronous call that waits. `woken` gets an item when another thread has news for it."""

    __slots__ = ("error", "reply", "woken")

    def __init__(self) -> None:
        self.reply: Reply | None = None
        self.error: type[TransportError] | None = None
        self.woken: queue.SimpleQueue[None] | None = None


class _Caller(_AskingLink):
    """Who waits for a reply receives it itself, and those of others that come meanwhile.

    Of several threads that wait, one is the receiver, and another becomes it when that one leaves.
    If none waits, but there are Futures, the crew attends to the replies.
    """

    role, facing = "calls", "serves"

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._response = Message(channel.type.response)
        self._flags = Flag.IDEMPOTENT if channel.idempotent else Flag.NONE
        self._numbers = itertools.count(1)
        self._pending = Pending(channel.name)
        self._askers: dict[int, _Asker] = {}
        self._turn = threading.Lock()
        self._receiver: _Asker | None = None
        self._crew_receives = False
        self._waiting = self.bus.waiting()

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        end = time.monotonic() + deadline
        found = self.server(end)
        number = next(self._numbers)
        future = self._pending.add(number, deadline)
        try:
            self._still(found)
            if not self.write(found[1], payload, self._flags, number, end):
                self._pending.fail(number, Timeout(f"{self.channel.name}: could not be asked within {deadline:g} s"))
        except BaseException:
            future.cancel()
            raise
        with self._turn:
            if self._receiver is None:
                self._have_crew_receive()
        self.bus.loop.due(end)
        return future

    def ask(self, payload: Payload, deadline: float) -> Reply:
        end = time.monotonic() + deadline
        found = self.server(end)
        number, asker = next(self._numbers), _Asker()
        self._askers[number] = asker
        try:
            self._still(found)
            if not self.write(found[1], payload, self._flags, number, end):
                raise Timeout(f"{self.channel.name}: could not be asked within {deadline:g} s")
            reply = self._await(asker, end)
        finally:
            del self._askers[number]
        if reply is None:
            raise Timeout(f"{self.channel.name}: no answer in {deadline:g} s")
        return self._understood(reply)

    def tick(self) -> float:
        wait = self._pending.expire()
        return float("inf") if wait is None else time.monotonic() + wait

    def lost(self) -> None:
        for line in self._lines.values():
            self._take(line)  # what it answered before it left
        self._give_up(Unreachable)

    def release(self) -> None:
        self._give_up(Closed)
        with self._turn:
            self._stop_crew()
        super().release()
        with self._turn:
            self._waiting.close()

    def _connect(self, name: str) -> None:
        super()._connect(name)
        replies = self._lines[name].replies
        assert replies
        self._waiting.attach(replies.condition)
        if self._crew_receives:
            self.bus.loop.attach(replies.condition, partial(self._on_reply, self._lines[name]))

    def _disconnect(self, line: _Line) -> None:
        assert line.replies
        self._waiting.detach(line.replies.condition)
        self.bus.loop.detach(line.replies.condition)
        super()._disconnect(line)

    def _still(self, found: tuple[Endpoint, _Line]) -> None:
        """Raise if the server left before we were among those who are told."""
        if self._found is not found:
            self.check_open()
            raise Unreachable(self._reason(Unreachable))

    def _give_up(self, why: type[TransportError]) -> None:
        self._pending.fail_all(why(self._reason(why)))
        for asker in list(self._askers.values()):
            asker.error = why
            if asker.woken:
                asker.woken.put(None)
        self._waiting.wake()

    def _reason(self, why: type[TransportError]) -> str:
        return f"{self.channel.name}: {'the link is closed' if why is Closed else 'its server left'}"

    def _await(self, asker: _Asker, end: float) -> Reply | None:
        """The reply, or None if there is none in time."""
        try:
            while True:
                receives = self._takes_turn(asker)
                if asker.reply is not None:
                    return asker.reply
                if asker.error:
                    raise asker.error(self._reason(asker.error))
                left = end - time.monotonic()
                if left <= 0:
                    return None
                if receives:
                    self._receive(left)
                else:
                    assert asker.woken
                    with contextlib.suppress(queue.Empty):
                        asker.woken.get(timeout=left)
        finally:
            self._leave_turn(asker)

    def _takes_turn(self, asker: _Asker) -> bool:
        """Whether this one receives; if not, it will be woken."""
        with self._turn:
            if self._receiver is None:
                self._receiver = asker
                self._stop_crew()
            elif self._receiver is not asker and asker.woken is None:
                asker.woken = queue.SimpleQueue()
            return self._receiver is asker

    def _leave_turn(self, asker: _Asker) -> None:
        with self._turn:
            if self._receiver is not asker:
                return
            self._receiver = None
            for other in list(self._askers.values()) if len(self._askers) > 1 else ():
                if other.woken and other.reply is None and other.error is None:
                    self._receiver = other
                    other.woken.put(None)
                    return
            if len(self._pending):
                self._have_crew_receive()

    def _have_crew_receive(self) -> None:
        if not self._crew_receives and not self.closed.is_set():
            self._crew_receives = True
            for line in self._lines.values():
                assert line.replies
                self.bus.loop.attach(line.replies.condition, partial(self._on_reply, line))

    def _stop_crew(self) -> None:
        if self._crew_receives:
            self._crew_receives = False
            for line in self._lines.values():
                assert line.replies
                self.bus.loop.detach(line.replies.condition)

    def _receive(self, timeout: float) -> None:
        if self._waiting.wait(timeout):
            for line in list(self._lines.values()):
                self._take(line)

    def _on_reply(self, line: _Line) -> list[Job]:
        self._take(line)
        if self._receiver:
            self._waiting.wake()  # it may have been its reply
        return []

    def _take(self, line: _Line) -> None:
        assert line.replies
        for sample in line.replies.take(BATCH):
            try:
                header = read_reply(sample)
                status = _STATUSES[header.status]
                ok = status is Status.OK
                payload = self._response.payload(sample, tail=True) if ok else self._response.why(sample)
            except (DecodeError, KeyError) as exc:
                self.malformed(exc)
                continue
            if header.client == self.id:
                self._answered(header.sequence, Reply(status, payload))

    def _answered(self, number: int, reply: Reply) -> None:
        asker = self._askers.get(number)
        if asker:
            asker.reply = reply
            if asker.woken:
                asker.woken.put(None)
            return
        try:
            self._pending.settle(number, self._understood(reply))
        except ContractMismatch as exc:
            self._pending.fail(number, exc)

    def _understood(self, reply: Reply) -> Reply:
        if reply.status is Status.MISMATCH:
            text = bytes(bare(reply.payload)).decode(errors="replace") if reply.payload else ""
            raise ContractMismatch(mismatch(self.channel, TypeRef("", 0, text)))
        return reply


# -- commands and queries, the serving side -----------------------------------


class _ServingLink(_Link):
    ordered: bool
    claimed: Claim | None = None

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._message = Message(channel.type.request)
        self._ledger = Ledger(self.stats, ordered=self.ordered)
        self._requests: Reader | None = None

    def open(self) -> None:
        name, kind = self.channel.name, self.channel.type
        self.claimed = claim(self.transport.folder, name, self.transport.owner or "a component")
        for endpoint in self.bus.endpoints.find(self.role, name):  # on another host
            raise TransportError(f"{name}: already served by {endpoint.owner} (pid {endpoint.pid})")
        made = request_type(kind.name, kind.request)
        self._requests = self.bus.reader(f"rc/{name}Request", made, _qos(_KEEP_ALL, self.about()))
        self.bus.loop.attach(self._requests.condition, self._on_request)

    def accept(self, request: Request, payload: Payload, expires: float) -> Job | None:
        """Take a request; what is left to do about it."""
        raise NotImplementedError

    def refuse(self, request: Request) -> None:
        """Answer one that means something else."""

    def release(self) -> None:
        if self._requests:
            self.bus.loop.detach(self._requests.condition)
            self._requests.close()
        if self.claimed:
            self.claimed.close()

    def _on_request(self) -> list[Job]:
        assert self._requests
        jobs = []
        for sample in self._requests.take(BATCH):
            job = self._take(sample)
            if job:
                jobs.append(job)
        return jobs

    def _take(self, sample: bytes) -> Job | None:
        try:
            request = read_request(sample)
            if request.fingerprint != self.channel.type.fingerprint:
                self.report_mismatch((request.client, request.fingerprint), self._stranger(request))
                self.refuse(request)
                return None
            payload = self._message.payload(sample)
        except DecodeError as exc:
            self.malformed(exc)
            return None
        if not self._ledger.admit(request.client, request.sequence):
            return None
        remaining = request.remaining_ms / 1000 if request.remaining_ms != NO_DEADLINE else float("inf")
        return self.accept(request, payload, time.monotonic() + remaining)

    def _stranger(self, request: Request) -> TypeRef:
        asking = self.bus.endpoints.find(self.facing, self.channel.name)
        texts = (endpoint.text for endpoint in asking if endpoint.fingerprint == request.fingerprint)
        return TypeRef("", request.fingerprint, next(texts, ""))


class _CommandInlet(_ServingLink):
    role, facing, ordered = "receives", "commands", True

    def __init__(self, transport: DDSTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._sink = sink
        self._lane = Lane(channel.name, self._execute, COMMANDS_WAITING, lossy=False, stats=self.stats)

    def accept(self, request: Request, payload: Payload, expires: float) -> Job | None:
        if self._lane.put((expires, payload)):
            return self._lane.drain
        self.stats.dropped += 1
        if self.stats.dropped == 1:
            log.warning("%s: %d commands wait; dropping more", self.channel.name, COMMANDS_WAITING)
        return None

    def release(self) -> None:
        super().release()
        self._lane.close()

    def _execute(self, waiting: tuple[float, Payload]) -> None:
        expires, payload = waiting
        if time.monotonic() >= expires:
            self.stats.expired += 1
        else:
            self._sink(payload)


class _Server(_ServingLink):
    """A reply waits until its client's reader is known: what is written before that is lost."""

    role, facing, ordered = "serves", "calls", False

    def __init__(self, transport: DDSTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._service = service
        self._gate = Gate(channel.name)
        self._response = Message(channel.type.response)
        self._writers: dict[str, Writer] = {}
        self._others = False
        """Whether there are clients that know nothing of our partitions."""
        self._deferred: list[tuple[float, Request, bytearray]] = []
        self._order = threading.Lock()

    def open(self) -> None:
        super().open()
        self._writers[""] = self._writer("")  # whom others see, and where they read

    def looked(self, there: list[Endpoint]) -> None:
        ends = self.bus.endpoints.on_topic(f"rc/{self.channel.name}Reply")
        partitions = {endpoint.partition for endpoint in ends if not endpoint.writes}
        self._others = "" in partitions
        for gone in self._writers.keys() - partitions - {""}:
            self._writers.pop(gone).close()
        for new in partitions - self._writers.keys():
            self._writers[new] = self._writer(new)
        with self._order:
            deferred, self._deferred = self._deferred, []
        for expires, request, sample in deferred:
            writer = self._writers.get(_partition_of(request.client))
            if writer:
                writer.write(sample)  # to a reader that has just come: there is room
            else:
                with self._order:
                    self._deferred.append((expires, request, sample))

    def tick(self) -> float:
        now = time.monotonic()
        with self._order:
            self._deferred = [each for each in self._deferred if each[0] > now]
            return min((expires for expires, _, _ in self._deferred), default=float("inf"))

    def accept(self, request: Request, payload: Payload, expires: float) -> Job | None:
        return partial(self._serve, request, payload, expires)

    def refuse(self, request: Request) -> None:
        if not request.flags & Flag.ONEWAY:
            text = dressed(self.channel.type.text.encode())
            self._answer(request, time.monotonic() + PATIENCE, Reply(Status.MISMATCH, text))

    def release(self) -> None:
        if self._requests:
            self.bus.loop.detach(self._requests.condition)
        self._gate.close()
        for writer in self._writers.values():
            writer.close()  # before the reader, whose leaving tells callers that nothing will come any more
        super().release()

    def _serve(self, request: Request, payload: Payload, expires: float) -> None:
        answer = partial(self._answer, request, expires)
        if not self._gate.enter():
            answer(Reply(Status.REFUSED))
            return
        try:
            if time.monotonic() >= expires:
                self.stats.expired += 1
                answer(Reply(Status.EXPIRED))
                return
            self.stats.received += 1
            serve(self._service, payload, expires, answer)
        finally:
            self._gate.leave()

    def _answer(self, request: Request, expires: float, reply: Reply) -> None:
        try:
            if reply.status is Status.OK:
                sample = whole(self._response.sample(reply.payload, tail=True))
            else:
                sample = self._response.failure(reply.payload)
            with self._order:  # a service may answer several with the same payload
                fill_reply(
                    sample,
                    reply.status,
                    request.client,
                    request.sequence,
                    self.transport.incarnation,
                    time.time_ns(),
                )
                writer = self._writers.get(_partition_of(request.client))
                if writer and writer.write(sample):
                    return
                sample = bytearray(sample)
            self._send_later(request, sample, expires)
        except TransportError as exc:
            if not self.closed.is_set():
                log.warning("%s: a reply was dropped: %s", self.channel.name, exc)

    def _send_later(self, request: Request, sample: bytearray, expires: float) -> None:
        """Send a reply for which there was no room, or no way to the client."""
        now = time.monotonic()
        expires = max(now + SOON, min(expires, now + PATIENCE))
        writer = self._writers.get(_partition_of(request.client))
        if writer is None:
            if self._others:
                self._writers[""].write(sample)
            with self._order:
                self._deferred.append((expires, request, sample))
            self.bus.loop.due(expires)
        elif not writer.write_within(sample, expires, self.check_open):
            log.warning("%s: a reply was dropped: who asked does not take it", self.channel.name)

    def _writer(self, partition: str) -> Writer:
        kind = self.channel.type
        made = reply_type(kind.response.name if kind.response else kind.name, kind.response)
        about = self.about("answers")
        return self.bus.writer(f"rc/{self.channel.name}Reply", made, _qos(_KEEP_ALL, about), partition)
