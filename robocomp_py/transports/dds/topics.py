"""Publishers and subscribers."""

from __future__ import annotations

import contextlib
import logging
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from cyclonedds.core import Qos

from ...contract.qos import DEFAULT_QOS, Liveliness, QoS, from_traits, shortfalls
from ...errors import (
    DecodeError,
    Timeout,
    TransportError,
)
from ...wire.codec import Payload
from ...wire.names import ANY
from ..base import (
    Channel,
    Sink,
    Source,
    SupportsHeard,
    SupportsSources,
    about_to_block,
    depth_of,
)
from ..directory import state_of
from ..leader_followers import Job, Lane
from ..ledger import Ledger
from ..limits import BATCH, BYTES_WAITING
from ..reception import Reception
from .bus import Reader, Writer
from .endpoints import Endpoint
from .library import LARGE
from .link import INTAKE, KEEP_ALL, SOON, STRANGERS, Link, best_effort_qos, endpoint_qos, enter, topic_qos
from .types import (
    BEFORE_TAIL,
    START,
    Credit,
    Message,
    credit_type,
    fill_publication,
    pack_credit,
    publication_fields,
    publication_type,
    read_credit,
    unreadable,
)

if TYPE_CHECKING:
    from .transport import DDSTransport

log = logging.getLogger("robocomp.transport.dds")

MESSAGES_WAITING = 1000
"""Messages of a best-effort publisher that may wait for a reliable subscriber; more are dropped."""

MOST_WAITING = 100_000
"""The same of all its publishers; those who count are told before that to wait."""

UNGREETED = 100
"""Messages that a subscriber gets before it has said how many it takes."""

_NONE = float("inf")
"""No limit."""

_SELDOM = 1.0
"""Seconds between two looks for a reader that DDS tells of, but has not connected for a while."""

_NO_DATA = bytes(64)


class Publisher(Link, SupportsHeard):
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
        self._limit: float = _NONE
        """The least of these."""
        self._greeted: set[int] = set()
        self._early: dict[int, Credit] = {}
        self._greeted_handles: set[int] = set()
        """The readers that have been told that they are connected."""
        self._due = _NONE
        """When to look for readers that are not connected yet."""
        self._patience = SOON
        self._unmet: set[str] = set()

    def open(self) -> None:
        channel = self.channel
        self.transport.limits.check(channel)
        kind = publication_type(channel.type.name, channel.type.request)
        self._writer = self.bus.writer(
            f"rc/{channel.name}", kind, topic_qos(channel, self.transport.limits, self.about())
        )
        if channel.qos.reliable:
            about = self.about("credited")
            self._credits = self.bus.reader(f"rc/{channel.name}Credit", credit_type(), endpoint_qos(KEEP_ALL, about))
            self.bus.loop.attach(self._credits.condition, self._on_credit)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        message = self._message
        sample = payload if message.plain and type(payload) is bytearray else message.sample(payload)
        if not self._order.acquire(False):
            enter(self, self._order, deadline)
        try:
            if self.closed.is_set() or self.transport.closed:
                self.check_open()
            number = self._sent + 1
            if number > self._limit and not self._await_credit(number, end):
                raise Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")
            fill_publication(sample, 0, START, self._fingerprint, self.id, number, time.time_ns())
            out = sample[:BEFORE_TAIL] if len(sample) < LARGE else memoryview(sample)[:BEFORE_TAIL]
            if self._credits is None:
                self._sent = number  # whether it gets away or not: who hears the next one knows what is missing
                self.stats.dropped += not self._written(out)
            elif self._written(out) or self._write_within(out, end):
                self._sent = number
            else:
                raise Timeout(f"{self.channel.name}: the network did not take a message for {deadline:g} s")
        finally:
            self._order.release()

    def tick(self) -> float | None:
        if time.monotonic() >= self._due:
            with self._looking:
                self._greet_readers()
        missing = self._writer.unmet() if self._writer else ""
        if missing and missing not in self._unmet:
            self._unmet.add(missing)
            log.warning(
                "%s: a subscriber asks for more %s than is offered here; if it is none of ours, it hears nothing. "
                "Let it ask for less, or this port offer more in its `qos`",
                self.channel.name,
                missing,
            )
        return self._due - time.monotonic()

    def visible(self) -> bool:
        same = {endpoint.handle for endpoint in self.counterparts(strict=True)}
        named = {endpoint.handle for endpoint in self.bus.endpoints.find(self.facing, self.channel.name)}
        matched = self._writer.matched() if self._writer else set()
        return bool(matched - (named - same))  # others than ours can only be right

    @property
    def heard(self) -> bool:
        return self.channel.qos.latched or bool(self._writer and self._writer.matched())

    def reached(self) -> set[int]:
        with self._looking:
            if self.closed.is_set():
                return set()
            self._greet_readers()
        return {endpoint.id for endpoint in self.counterparts() if endpoint.handle in self._greeted_handles}

    def _greet_readers(self) -> None:
        """Tell new readers that they are connected, by a sample without data, which is not delivered as a message.

        What is latched is not disturbed by that: its readers get the history anyway.
        """
        assert self._writer
        matched = self._writer.matched()
        if matched <= self._greeted_handles or self.channel.qos.latched or self._writer.greet(_NO_DATA):
            self._greeted_handles = matched
        missing = {endpoint.id for endpoint in self.counterparts()} - {
            endpoint.id for endpoint in self.counterparts() if endpoint.handle in self._greeted_handles
        }
        self._due = time.monotonic() + self._patience if missing else _NONE
        self._patience = min(2 * self._patience, _SELDOM)
        self.bus.loop.due(self._due)

    def looked(self, there: list[Endpoint]) -> None:
        self._patience = SOON
        self._greet_readers()
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
            self._limits_changed()

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

    def _write_within(self, sample: bytearray | memoryview, end: float) -> bool:
        assert self._writer
        return self._writer.write_within(sample, end, self._pause)

    def _pause(self) -> None:
        self.check_open()
        about_to_block()

    def _await_credit(self, number: int, end: float) -> bool:
        """Wait until every reader takes a message of that number."""
        about_to_block()  # what we wait for may come in by this very thread
        with self._room:
            patience = max(0.0, end - time.monotonic())
            self._room.wait_for(lambda: number <= self._limit or self.closed.is_set(), patience)
            self.check_open()
            return number <= self._limit

    def _limits_changed(self) -> None:
        """With the lock of `_room`."""
        self._limit = min(self._limits.values(), default=_NONE) if self._credits else _NONE
        self._room.notify_all()

    def _on_credit(self) -> list[Job]:
        assert self._credits
        for sample, info in self._credits.take(BATCH):
            if not info.valid_data:
                continue
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
        self._limits_changed()


class _Heard:
    """A topic that a subscriber hears: one, or with `*` each that has a publisher."""

    def __init__(self, name: str, reader: Reader, credits: Writer | None) -> None:
        self.name, self.reader, self.credits = name, reader, credits
        self.news: Reader | None = None
        """Hears publishers that offer less than we ask for (nothing for late ones, say), whom `reader` cannot hear."""
        self.common: Callable[..., Qos] = endpoint_qos
        """What `news` has in common with all readers, or with those that are best effort on the wire, too."""
        self.modest = False
        """Whether `news` asks for nothing that might be missing, and not only for less on the wire."""
        self.consumed: dict[int, int] = {}
        self.told: dict[int, int] = {}
        """By source: up to which message we said that we have consumed."""

    def readers(self) -> list[Reader]:
        return [self.reader, self.news] if self.news else [self.reader]

    def close(self) -> None:
        for each in (*self.readers(), self.credits):
            if each:
                each.close()


_Message = tuple[_Heard, int, int, int, Payload]
"""What was heard by what, from which source, its number, the size of the sample, and the payload."""


class Subscriber(Link, SupportsSources):
    """A reliable one takes all that comes in, for its publishers know how much it takes (`Credit`).

    Others than ours do not, nor do those that publish best effort; of theirs, only so many may wait.
    """

    role, facing = "subscribes", "publishes"

    def __init__(self, transport: DDSTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._reliable = channel.qos.reliable
        self._sink = sink
        self._window = depth_of(channel.qos)
        self._intake = INTAKE if self._reliable else BATCH  # the reader of the others keeps the newest ones only
        depth = MOST_WAITING if self._reliable else self._window
        consume: Sink = self._consume if self._reliable else sink
        self._lane = Lane(channel.name, consume, depth, lossy=not self._reliable, stats=self.stats)
        self._message = Message(channel.type.request)
        self._fingerprint = channel.type.fingerprint
        self._reception = Reception(channel, self.stats, self._through)
        self._ledger = Ledger(self.stats, ordered=True)
        self._heard: dict[str, _Heard] = {}
        self._greeted: set[int] = set()
        """The writers of which we have heard: they are connected."""
        self._handles: set[int] = set()
        """The writers that DDS told of when we last looked."""
        self._counting: dict[int, bool] = {}
        """By publisher: whether it counts, and waits for us."""
        self._put = self._consumed = 0
        self._put_bytes = self._consumed_bytes = 0
        self._most = self._window + MESSAGES_WAITING
        """So many may wait of publishers that do not count."""
        self._telling = max(1, self._window // 2)
        """After so many messages we say that we have consumed them."""
        self._due = float("inf")

    def open(self) -> None:
        self.transport.limits.check(self.channel)
        if ANY not in self.channel.name:
            self._hear(self.channel.name)

    def looked(self, there: list[Endpoint]) -> None:
        if ANY in self.channel.name:
            names = {endpoint.channel for endpoint in there}
            names.update(self.bus.endpoints.published_by_others(self.channel.name)[:STRANGERS])
            for name in self._heard.keys() - names:
                self._unhear(name)
            for name in names - self._heard.keys():
                self._hear(name)
        self._counting = {endpoint.id: endpoint.reliable for endpoint in there}
        handles = {endpoint.handle for endpoint in there}
        self._greeted -= self._handles - handles
        self._handles = handles
        if self._reliable:
            self._greet()
        self._reception.meet(map(_source, there))
        for endpoint in there:
            self._get_along_with(endpoint)

    def tick(self) -> float | None:
        if time.monotonic() >= self._due:
            with self._looking:
                if not self.closed.is_set():
                    self._greet()
        with self._looking:
            for heard in [] if self.closed.is_set() else self._heard.values():
                self._notice_strangers(heard)
        return self._due - time.monotonic()

    def reached(self) -> set[int]:
        connected = set(self._greeted)
        for heard in list(self._heard.values()):
            for reader in heard.readers():
                connected |= reader.matched() & self._latched
        return {endpoint.id for endpoint in self.counterparts() if endpoint.handle in connected}

    @property
    def _latched(self) -> set[int]:
        """The writers that send no greeting, since they have a history to give."""
        return {endpoint.handle for endpoint in self.counterparts() if endpoint.latched}

    def sources(self) -> list[Source]:
        there = self.counterparts()
        ours = {each.channel for each in there}
        others = [
            Source(name, DEFAULT_QOS)
            for name, heard in list(self._heard.items())
            if name not in ours and any(reader.alive() for reader in heard.readers())
        ]
        return [*(_source(each) for each in there if self._lives(each)), *others]

    def _lives(self, publisher: Endpoint) -> bool:
        """Whether DDS has heard of a publisher's process in time. What one does not send is the watch's business."""
        if from_traits(publisher.traits).liveliness is Liveliness.MANUAL_BY_TOPIC:
            return True
        heard = self._heard.get(publisher.channel)
        if heard and any(reader.alive() for reader in heard.readers()):
            return True
        # Of one that was late, DDS learns by its next sample only that it lives.
        return self.transport.local and state_of(publisher.pid) not in ("", "T", "Z", "X")

    def visible(self) -> bool:
        self.counterparts(strict=True)
        return any(reader.matched() for heard in list(self._heard.values()) for reader in heard.readers())

    def release(self) -> None:
        self._lane.close()
        for name in list(self._heard):
            self._unhear(name)

    def _through(self, wrap: Callable[[Sink], Sink]) -> None:
        self._sink = wrap(self._sink)
        if not self._reliable:
            self._lane.through(wrap)

    def _hear(self, name: str) -> None:
        credits = None
        if self._reliable:
            about = self.about("credits", name)
            credits = self.bus.writer(f"rc/{name}Credit", credit_type(), endpoint_qos(KEEP_ALL, about))
        self._heard[name] = heard = _Heard(name, self._reader(name, self.channel), credits)
        self.bus.loop.attach(heard.reader.condition, partial(self._on_message, heard))

    def _reader(self, name: str, channel: Channel, common: Callable[..., Qos] = endpoint_qos) -> Reader:
        kind = publication_type(channel.type.name, channel.type.request)
        qos = topic_qos(channel, self.transport.limits, self.about("subscribes", name), common=common)
        return self.bus.reader(f"rc/{name}", kind, qos)

    def _unhear(self, name: str) -> None:
        heard = self._heard.pop(name)
        for reader in heard.readers():
            self.bus.loop.detach(reader.condition)
        heard.close()

    def _get_along_with(self, publisher: Endpoint) -> None:
        """Hear as much as there is of one that offers less than we ask for, whom DDS would not let us hear."""
        asked = self.channel.qos
        less = [each for each in shortfalls(asked, from_traits(publisher.traits)) if each.policy != "reliability"]
        heard = self._heard.get(publisher.channel)
        if less and heard and not heard.modest:
            self._hear_news(heard, heard.common)

    def _hear_news(self, heard: _Heard, common: Callable[..., Qos], *, modest: bool = True) -> None:
        """Hear also those that offer less than we ask for; or, if not `modest`, less than all our readers have."""
        if heard.news:
            self.bus.loop.detach(heard.news.condition)
            heard.news.close()
        qos = self.channel.qos
        less = replace(self.channel, qos=QoS(qos.reliability, history=qos.history, depth=qos.depth))
        heard.news = self._reader(heard.name, less if modest else self.channel, common)
        heard.common, heard.modest = common, modest
        self.bus.loop.attach(heard.news.condition, partial(self._on_news, heard, heard.news))

    def _notice_strangers(self, heard: _Heard) -> None:
        """Other programs do not tell what they offer, but that something is missing."""
        for reader in heard.readers():
            missing = reader.unmet()
            unreliable = missing == "reliability"
            if unreliable and not self._reliable:  # then only our readers want it, for the wire
                if heard.common is not best_effort_qos:
                    self._hear_news(heard, best_effort_qos, modest=heard.modest)  # and see whether more is missing
                    return
                continue
            if not missing or (heard.modest and not unreliable):
                continue  # it is one of ours, or will be heard with the others
            log.warning(
                "%s: a publisher that is none of ours offers less %s than this subscription asks for; it is heard "
                "nevertheless, for what it is worth",
                heard.name,
                missing,
            )
            self._hear_news(heard, best_effort_qos if unreliable else heard.common)
            return

    def _on_message(self, heard: _Heard) -> list[Job]:
        return self._deliver(heard, heard.reader.take(self._intake))

    def _on_news(self, heard: _Heard, news: Reader) -> list[Job]:
        samples = news.take(self._intake)
        otherwise = heard.reader.matched()  # whom we hear, with what they have kept, by the other reader
        return self._deliver(heard, [each for each in samples if each[1].publication_handle not in otherwise])

    def _deliver(self, heard: _Heard, samples: list[tuple[bytes, Any]]) -> list[Job]:
        messages = []
        for sample, info in samples:
            if info.publication_handle not in self._greeted:
                self._greeted.add(info.publication_handle)
                self._news.set()
            message = self._take(heard, sample) if info.valid_data else None
            if message is not None:
                messages.append(message)
        if not messages:
            return []
        taken = self._lane.put_all(messages)
        if taken < len(messages):
            self._give_up(messages[taken:])
        return [self._lane.drain] if self._lane.summon() else []

    def _take(self, heard: _Heard, sample: bytes) -> Payload | _Message | None:
        """A message that means what we mean, is new, and has room here; if we count, with what is to be told of it."""
        try:
            start, fingerprint, source, sequence, stamp = publication_fields(sample)
            if start != START:
                raise unreadable(sample)
            if fingerprint != self._fingerprint:
                self.report_mismatch((source, fingerprint), fingerprint)
                return None
            payload = sample if self._message.plain else self._message.payload(sample)
        except (DecodeError, struct.error) as exc:
            self.malformed(exc)
            return None
        if not self._ledger.admit(source, sequence):
            return None
        if self._reliable and self._put - self._consumed >= self._window and not self._counting.get(source, True):
            waiting, octets = self._put - self._consumed, self._put_bytes - self._consumed_bytes
            if waiting >= self._most or octets >= BYTES_WAITING:
                self.stats.dropped += 1
                return None
        if self._reception.on:
            payload = self._reception.admit(heard.name, stamp, payload)
        if not self._reliable:
            return payload
        self._put += 1
        self._put_bytes += len(sample)
        return heard, source, sequence, len(sample), payload

    def _give_up(self, messages: list[Any]) -> None:
        """These found no room."""
        self.stats.dropped += len(messages)
        if self._reliable:
            self._put -= len(messages)
            self._put_bytes -= sum(size for *_, size, _ in messages)

    def _consume(self, message: _Message) -> None:
        heard, source, sequence, size, payload = message
        self._consumed += 1
        self._consumed_bytes += size
        try:
            self._sink(payload)
        finally:
            if heard.credits:
                heard.consumed[source] = sequence
                if sequence - heard.told.get(source, sequence) >= self._telling:
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


def _source(publisher: Endpoint) -> Source:
    return Source(publisher.channel, from_traits(publisher.traits))
