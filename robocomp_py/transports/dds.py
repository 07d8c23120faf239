"""Transport `dds`: Cyclone DDS; other vendors' tools see our topics, types and fields.

    rc/<channel>            publications, 1:n
    rc/<channel>Credit      how far the readers of a reliable topic are, to its publisher
    rc/<channel>Request     commands and requests, n:1
    rc/<channel>Reply       replies; every client has a partition of its own, and the server a writer in it

Who is there is told by the endpoints themselves: each carries its role and contract as USER_DATA
(`dds_bus.Endpoints`). DDS itself acknowledges a sample when it has arrived, not when it was read,
and a reader without room would stop all others of its process; so a reliable topic counts: its
publisher sends no more than its readers have said they take (`Credit`).

Nothing is refused by a reader: what comes in is taken at once and waits here, so many of a link and
no more. Whom that concerns is told (`BUSY`), or finds it counted.

Threads. The leader of a `Crew` waits for all readers and runs sinks and services itself. A
synchronous call waits for its reply on its own thread.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import queue
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from cyclonedds.core import Policy, Qos

from ..contract.interface import Pattern
from ..contract.qos import Durability, History
from ..errors import (
    AlreadyServed,
    Closed,
    ConfigurationError,
    ContractMismatch,
    DecodeError,
    Timeout,
    TransportError,
    Unreachable,
)
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
from .crew import Crew, Gate, Job, Lane, abandoned
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
    without_tail,
)
from .directory import runtime_dir
from .exclusive import Claim, claim
from .ledger import Ledger
from .pending import Pending

log = logging.getLogger("robocomp.transport.dds")

BATCH = 32
"""Messages taken from one reader before the others have their turn."""

INTAKE = 2000
"""The same of those that would pile up in the reader while somebody is slow: more than can come in meanwhile."""

STRANGERS = 100
"""So many that mean something else by a channel's name are told about; the others are ignored."""

TICK = 0.5
"""Seconds between two looks whether somebody forgot to close us."""

KEEP_ALL_DEPTH = 10_000
COMMANDS_WAITING = 1000

QUERIES_WAITING = 1000
"""Requests that may wait at one server, or be under way there; more are turned away."""

MESSAGES_WAITING = 1000
"""Messages of a best-effort publisher that may wait for a reliable subscriber; more are dropped."""

MOST_WAITING = 100_000
"""The same of all its publishers; those who count are told before that to wait."""

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
        self.gone = "the link is closed"
        self.bus = Bus(domain, interface)
        self.bus.on_loss = self._lose
        self.bus.endpoints.on_change = self._look
        self.bus.loop.tick = self._tick
        self._crew = Crew("dds", self.bus.loop.receive, self.bus.loop.wake)
        try:
            self._crew.start()
        except RuntimeError as exc:
            self._crew.close()
            self.bus.close()
            raise TransportError(f"dds: cannot be opened: {exc}; allow for more threads (`ulimit -u`)") from exc

    def outlet(self, channel: Channel) -> _Publisher | _CommandOutlet:
        kind = _Publisher if channel.pattern is Pattern.PUBLISH else _CommandOutlet
        return self._open(lambda: kind(self, channel))

    def inlet(self, channel: Channel, sink: Sink) -> _Subscriber | _CommandInlet:
        kind = _Subscriber if channel.pattern is Pattern.PUBLISH else _CommandInlet
        return self._open(lambda: kind(self, channel, sink))

    def caller(self, channel: Channel) -> _Caller:
        return self._open(lambda: _Caller(self, channel))

    def server(self, channel: Channel, service: Service) -> _Server:
        return self._open(lambda: _Server(self, channel, service))

    def close(self) -> None:
        with self._lock:
            if self.closed:
                return
            self.closed = True
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            everything.callback(self.bus.close)
            everything.callback(self._crew.close)
            for link in list(self._links):
                everything.callback(link.close)

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

    def _open(self, make: Callable[[], L]) -> L:
        if self.closed:
            raise Closed(f"the transport is closed: {self.gone}" if self.bus.lost else "the transport is closed")
        link = make()
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

    def _lose(self) -> None:
        """In a process forked from ours, where nothing of this works."""
        self.closed = True
        self._lock = threading.RLock()  # the former one may be held by a thread that is not here
        self.gone = "it was opened before this process was forked, which has to open its own"
        for link in self._links:
            link.lose()

    # On the receiving thread, which must go on whatever happens.

    def _look(self) -> None:
        for link in list(self._links):
            with self._guarded(link):
                link.look()

    def _tick(self) -> float:
        if abandoned():
            log.warning("%s: not closed at the end of the program; closing", self.owner or "dds")
            self.close()
            return float("inf")
        due = time.monotonic() + TICK
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
        if not self.bus.lost:
            self.release()

    def release(self) -> None:
        """Let go of what this link holds; called once, when it is closed."""

    def lose(self) -> None:
        """Be closed, in a forked process."""
        self.closed = threading.Event()  # the locks of the former one may be held by threads that are not here
        self.closed.set()

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
            raise Closed(f"{self.channel.name}: {self.transport.gone}")

    def report_mismatch(self, who: object, other: TypeRef) -> None:
        if who not in self._reported and len(self._reported) < STRANGERS:
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


def enter(link: _Link, order: threading.Lock, deadline: float) -> None:
    """Take the lock of those who send by a link, who may hold it until deadlines of their own."""
    if order.acquire(blocking=False):
        return
    step_aside()  # what they wait for may come in by this very thread
    if not order.acquire(timeout=max(0.0, deadline)):
        raise Timeout(f"{link.channel.name}: another thread was still sending after {deadline:g} s")


# -- topics -------------------------------------------------------------------


class _Publisher(_Link):
    role, facing = "publishes", "subscribes"

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._message = Message(channel.type.request)
        self._fingerprint = channel.type.fingerprint
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
        enter(self, self._order, deadline)
        try:
            self.check_open()
            if self._credits and not self._await_credit(self._sent + 1, end):
                raise Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")
            fill_publication(sample, self._fingerprint, self.id, self._sent + 1, time.time_ns())
            if self._credits is None:
                self._sent += 1  # whether it gets away or not: who hears the next one knows what is missing
                self.stats.dropped += not self._written(without_tail(sample))
            elif self._written_within(without_tail(sample), end):
                self._sent += 1
            else:
                raise Timeout(f"{self.channel.name}: the network did not take a message for {deadline:g} s")
        finally:
            self._order.release()

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

    def _written(self, sample: memoryview) -> bool:
        assert self._writer
        try:
            return self._writer.write(sample)
        except TransportError:
            self.check_open()
            raise

    def _written_within(self, sample: memoryview, end: float) -> bool:
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
        self.news: Reader | None = None
        """Hears publishers that keep nothing for late subscribers, whom `reader` cannot hear if we ask for that."""
        self.consumed: dict[int, int] = {}
        self.told: dict[int, int] = {}
        """By source: up to which message we said that we have consumed."""

    def readers(self) -> list[Reader]:
        return [self.reader, self.news] if self.news else [self.reader]

    def close(self) -> None:
        for each in (*self.readers(), self.credits):
            if each:
                each.close()


class _Subscriber(_Link):
    """A reliable one takes all that comes in, for its publishers know how much it takes (`Credit`).

    Others than ours do not, nor do those that publish best effort; of theirs, only so many may wait.
    """

    role, facing = "subscribes", "publishes"

    def __init__(self, transport: DDSTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._reliable = channel.qos.reliable
        self._sink = sink
        self._window = _depth(channel)
        self._intake = INTAKE if self._reliable else BATCH  # the reader of the others keeps the newest ones only
        depth = MOST_WAITING if self._reliable else self._window
        self._lane = Lane(channel.name, self._consume, depth, lossy=not self._reliable, stats=self.stats)
        self._message = Message(channel.type.request)
        self._ledger = Ledger(self.stats, ordered=True)
        self._heard: dict[str, _Heard] = {}
        self._counting: dict[int, bool] = {}
        """By publisher: whether it counts, and waits for us."""
        self._met: set[int] = set()
        self._put = self._consumed = 0
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
        self._counting = {endpoint.id: endpoint.reliable for endpoint in there}
        if self._reliable:
            self._greet()
        self._met &= self._counting.keys()
        for endpoint in there:
            self._get_along_with(endpoint)

    def tick(self) -> float:
        if time.monotonic() >= self._due:
            with self._looking:
                if not self.closed.is_set():
                    self._greet()
        return self._due

    def visible(self) -> bool:
        self.counterparts(strict=True)
        return any(reader.matched() for heard in list(self._heard.values()) for reader in heard.readers())

    def release(self) -> None:
        self._lane.close()
        for name in list(self._heard):
            self._unhear(name)

    def _hear(self, name: str) -> None:
        credits = None
        if self._reliable:
            about = self.about("credits", name)
            credits = self.bus.writer(f"rc/{name}Credit", credit_type(), _qos(_KEEP_ALL, about))
        self._heard[name] = heard = _Heard(self._reader(name, self.channel), credits)
        self.bus.loop.attach(heard.reader.condition, partial(self._on_message, heard))

    def _reader(self, name: str, channel: Channel) -> Reader:
        kind = publication_type(channel.type.name, channel.type.request)
        return self.bus.reader(f"rc/{name}", kind, _topic_qos(channel, self.about("subscribes", name)))

    def _unhear(self, name: str) -> None:
        heard = self._heard.pop(name)
        for reader in heard.readers():
            self.bus.loop.detach(reader.condition)
        heard.close()

    def _get_along_with(self, publisher: Endpoint) -> None:
        """Hear as much as there is of one that offers less than we ask for, and say once what is missing."""
        asked, name = self.channel.qos, self.channel.name
        if asked.latched and not publisher.latched:
            heard = self._heard.get(publisher.channel)
            if heard and heard.news is None:
                volatile = replace(self.channel, qos=replace(asked, durability=Durability.VOLATILE))
                heard.news = self._reader(publisher.channel, volatile)
                self.bus.loop.attach(heard.news.condition, partial(self._on_news, heard, heard.news))
        if publisher.id in self._met:
            return
        self._met.add(publisher.id)
        who = publisher.owner or "a publisher"
        if asked.latched and not publisher.latched:
            log.warning(
                "%s: %s does not keep messages for late subscribers, as we ask; we hear what it publishes from now on. "
                'Give its port the qos that ours has, or ours `durability = "volatile"`',
                name,
                who,
            )
        if asked.reliable and not publisher.reliable:
            log.warning(
                "%s: %s publishes best effort, so it does not wait while we are slow, as we ask. "
                'Give its port the qos that ours has, or ours `reliability = "best_effort"`',
                name,
                who,
            )

    def _on_message(self, heard: _Heard) -> list[Job]:
        return self._deliver(heard, heard.reader.take(self._intake))

    def _on_news(self, heard: _Heard, news: Reader) -> list[Job]:
        signed = news.take_signed(self._intake)
        otherwise = heard.reader.matched()  # whom we hear, with what they have kept, by the other reader
        return self._deliver(heard, [sample for sample, writer in signed if writer not in otherwise])

    def _deliver(self, heard: _Heard, samples: list[bytes]) -> list[Job]:
        taken = 0
        for sample in samples:
            taken += self._take(heard, sample)
        return [self._lane.drain] if taken and self._lane.summon() else []

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
        source = header.source
        if not self._ledger.admit(source, header.sequence):
            return False
        if self._reliable:
            waiting = self._put - self._consumed
            if waiting >= self._window + MESSAGES_WAITING and not self._counting.get(source, True):
                self.stats.dropped += 1
                return False
        if self._lane.put((heard, source, header.sequence, payload)):
            self._put += 1
            return True
        self.stats.dropped += 1
        return False

    def _consume(self, message: tuple[_Heard, int, int, Payload]) -> None:
        heard, source, sequence, payload = message
        self._consumed += 1
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


def _client_of(partition: str) -> tuple[int, str]:
    """Whose partition it is; nobody's is 0."""
    return int(partition, 16) if re.fullmatch("[0-9a-f]{16}", partition) else 0, partition


class _AskingLink(_Link):
    """A link that finds the one process that serves its channel."""

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._message = Message(channel.type.request)
        self._fingerprint = channel.type.fingerprint
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

    def lose(self) -> None:
        super().lose()
        self._found = None

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
                fill_request(sample, flags, left, self._fingerprint, self.id, number, time.time_ns())
                if line.requests.write(without_tail(sample)):
                    return True
                copy = bytearray(without_tail(sample))
            return line.requests.write_within(copy, end, self._pause)
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
        enter(self, self._order, deadline)
        try:
            _, line = self.server(end)
            if not self.write(line, payload, Flag.ONEWAY, self._sent + 1, end):
                raise Timeout(f"{self.channel.name}: its server did not take the command for {deadline:g} s")
            self._sent += 1
        finally:
            self._order.release()


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
        self._crew_receives = self._asynchronous = False
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
            self._asynchronous = True
            if self._receiver is None:
                self._have_crew_receive()
        self.bus.loop.due(end)
        return future

    def ask(self, payload: Payload, deadline: float) -> Reply:
        end = time.monotonic() + deadline
        found = self._found or self.server(end)
        number, asker = next(self._numbers), _Asker()
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
        return reply if reply.status is Status.OK else self._understood(reply)

    def tick(self) -> float:
        wait = self._pending.expire(self.bus.loop.do)
        return float("inf") if wait is None else time.monotonic() + wait

    def lost(self) -> None:
        for line in self._lines.values():
            self._take(line)  # what it answered before it left
        self._pending.fail_all(Unreachable(self._reason(Unreachable)), do=self.bus.loop.do)
        self._release_askers(Unreachable)

    def release(self) -> None:
        self._found = None  # first: who asks from now on is not among those who are told
        self._pending.close(Closed(self._reason(Closed)))
        self._release_askers(Closed)
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
        receives = self._takes_turn(asker)
        try:
            while True:
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
                    receives = self._takes_turn(asker)
        finally:
            self._leave_turn(asker)

    def _takes_turn(self, asker: _Asker) -> bool:
        """Whether this one receives, until it leaves its turn; if not, it will be woken."""
        with self._turn:
            if self._receiver is None:
                self._receiver = asker
                if self._crew_receives:
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
            if self._asynchronous and len(self._pending):
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
                _, status, client, number, _, _ = read_reply(sample)
                if status == Status.OK:
                    reply = Reply(Status.OK, self._response.payload(sample, tail=True))
                else:
                    reply = Reply(_STATUSES[status], self._response.why(sample))
            except (DecodeError, KeyError) as exc:
                self.malformed(exc)
                continue
            if client != self.id:
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
        if reply.status is Status.MISMATCH:
            text = bytes(bare(reply.payload)).decode(errors="replace") if reply.payload else ""
            raise ContractMismatch(mismatch(self.channel, TypeRef("", 0, text)))
        return reply


# -- commands and queries, the serving side -----------------------------------


_Asked = tuple[Request, Payload, float]
"""A request, what is asked, and when that expires."""


class _ServingLink(_Link):
    ordered: bool
    claimed: Claim | None = None

    def __init__(self, transport: DDSTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._message = Message(channel.type.request)
        self._fingerprint = channel.type.fingerprint
        self._ledger = Ledger(self.stats, ordered=self.ordered)
        self._requests: Reader | None = None

    def open(self) -> None:
        name, kind = self.channel.name, self.channel.type
        self.claimed = claim(self.transport.folder, name, self.transport.owner or "a component")
        for endpoint in self.bus.endpoints.find(self.role, name):  # on another host
            raise AlreadyServed(f"{name}: already served by {endpoint.owner} (pid {endpoint.pid})")
        made = request_type(kind.name, kind.request)
        self._requests = self.bus.reader(f"rc/{name}Request", made, _qos(_KEEP_ALL, self.about()))
        self.bus.loop.attach(self._requests.condition, self._on_request)

    def accept(self, samples: list[bytes]) -> list[Job]:
        """Have requests wait for their turn, or turn them away; what is to be done about those that wait."""
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
        return self.accept(self._requests.take(INTAKE))

    def read(self, sample: bytes) -> _Asked | None:
        """A request that means what we mean, and is new."""
        try:
            request = read_request(sample)
            if request.fingerprint != self._fingerprint:
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
        return request, payload, time.monotonic() + remaining

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

    def accept(self, samples: list[bytes]) -> list[Job]:
        for sample in samples:
            asked = self.read(sample)
            if asked is None or self._lane.put((asked[2], asked[1])):
                continue
            self.stats.dropped += 1
            if self.stats.dropped == 1:
                log.warning("%s: %d commands wait; dropping more", self.channel.name, COMMANDS_WAITING)
        return [self._lane.drain] if self._lane.summon() else []

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
    """A reply waits until its client's reader is known: what is written before that is lost.

    One request after the other is begun, and between two of them the other links have their turn,
    however many wait here.
    """

    role, facing, ordered = "serves", "calls", False

    def __init__(self, transport: DDSTransport, channel: Channel, service: Service) -> None:
        super().__init__(transport, channel)
        self._service = service
        self._gate = Gate(channel.name)
        self._response = Message(channel.type.response)
        self._writers: dict[str, Writer] = {}
        """By partition."""
        self._clients: dict[int, Writer] = {}
        """The same, by whom they reach."""
        self._others = False
        """Whether there are clients that know nothing of our partitions."""
        self._deferred: list[tuple[float, Request, bytearray]] = []
        self._order = threading.Lock()
        self._waiting: deque[_Asked] = deque()
        self._under_way: dict[tuple[int, int], float] = {}
        """When those that wait or are being served expire."""
        self._turned_away: deque[tuple[Request, float, Reply]] = deque(maxlen=QUERIES_WAITING)
        self._full_until = 0.0
        """When the next of those under way expires, if there were too many when we last looked."""
        self._beginning = self._refusing = False
        """Whether somebody will call `_begin`, and `_send_refusals`."""

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
        self._clients = {client: self._writers[name] for client, name in map(_client_of, partitions) if client}
        with self._order:
            deferred, self._deferred = self._deferred, []
        for expires, request, sample in deferred:
            writer = self._clients.get(request.client)
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

    def accept(self, samples: list[bytes]) -> list[Job]:
        for sample in samples:
            asked = self.read(sample)
            if asked is None:
                continue
            request, _, expires = asked
            if len(self._under_way) >= QUERIES_WAITING and not self._forget_expired():
                self.stats.dropped += 1
                self._turned_away.append((request, expires, Reply(Status.BUSY)))
                continue
            self._under_way[request.client, request.sequence] = expires
            if len(samples) == 1 and not self._waiting:
                return [partial(self._serve, asked)]  # as it is nearly always
            self._waiting.append(asked)
        return self._jobs()

    def refuse(self, request: Request) -> None:
        if not request.flags & Flag.ONEWAY:
            text = dressed(self.channel.type.text.encode())
            self._turned_away.append((request, time.monotonic() + PATIENCE, Reply(Status.MISMATCH, text)))

    def _jobs(self) -> list[Job]:
        """What is to be done, and is not being done."""
        jobs: list[Job] = []
        if self._waiting and not self._beginning:
            self._beginning = True
            jobs.append(self._begin)
        if self._turned_away and not self._refusing:
            self._refusing = True
            jobs.append(self._send_refusals)
        return jobs

    def release(self) -> None:
        if self._requests:
            self.bus.loop.detach(self._requests.condition)
        self._gate.close()
        for writer in self._writers.values():
            writer.close()  # before the reader, whose leaving tells callers that nothing will come any more
        super().release()

    def _begin(self) -> None:
        """Serve the one that came first, and have the next one begun, by whoever receives then."""
        try:
            asked = self._waiting.popleft()
        except IndexError:  # another thread was quicker
            return
        finally:
            self._beginning = False  # before looking for more: who adds some later sees this
            if self._waiting:
                for job in self._jobs():
                    self.bus.loop.do(job)
        self._serve(asked)

    def _send_refusals(self) -> None:
        self._refusing = False
        with contextlib.suppress(IndexError):  # another thread sends them, too
            while True:
                self._answer(*self._turned_away.popleft())

    def _forget_expired(self) -> bool:
        """Whether some requests that were never answered need not be counted any more."""
        now = time.monotonic()
        if now < self._full_until:
            return False
        under_way = list(self._under_way.items())
        for key, expires in under_way:
            if expires <= now:
                self._under_way.pop(key, None)
        self._full_until = min((expires for _, expires in under_way if expires > now), default=0.0)
        return len(self._under_way) < QUERIES_WAITING

    def _serve(self, asked: _Asked) -> None:
        request, payload, expires = asked
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
        self._under_way.pop((request.client, request.sequence), None)
        try:
            if reply.status is Status.OK:
                sample = self._response.sample(reply.payload)
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
                writer = self._clients.get(request.client)
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
        writer = self._clients.get(request.client)
        if writer is None:
            if self._others:
                self._writers[""].write(sample)
            with self._order:
                self._deferred.append((expires, request, sample))
                if len(self._deferred) > QUERIES_WAITING:
                    del self._deferred[0]
                    self.stats.dropped += 1
            self.bus.loop.due(expires)
        elif not writer.write_within(sample, expires, self._pause):
            log.warning("%s: a reply was dropped: who asked does not take it", self.channel.name)

    def _pause(self) -> None:
        self.check_open()
        step_aside()

    def _writer(self, partition: str) -> Writer:
        kind = self.channel.type
        made = reply_type(kind.response.name if kind.response else kind.name, kind.response)
        about = self.about("answers")
        return self.bus.writer(f"rc/{self.channel.name}Reply", made, _qos(_KEEP_ALL, about), partition)
