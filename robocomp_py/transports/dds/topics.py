"""The links of publications: publisher and subscriber."""

from __future__ import annotations

import contextlib
import logging
import math
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
    SupportsSources,
    SupportsSubscribers,
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
from .link import DISCOVERY_PAUSE, INTAKE, STRANGERS, Link, enter
from .qos import KEEP_ALL, best_effort_qos, endpoint_qos, topic_qos
from .types import (
    BEFORE_TAIL,
    START,
    Grant,
    Message,
    credit_type,
    fill_publication,
    pack_grant,
    publication_fields,
    publication_type,
    read_grant,
    unreadable,
)

if TYPE_CHECKING:
    from .core import DDSCore

log = logging.getLogger("robocomp.transport.dds")

MESSAGES_WAITING = 1000
"""Maximum number of a best-effort publisher's messages that wait in a reliable subscriber; more are dropped."""

MOST_WAITING = 100_000
"""The same for all its publishers together; publishers with credit stop before."""

INITIAL_CREDIT = 100
"""Credit of a subscriber before it has granted any."""

_NONE = math.inf
"""No limit."""

_LONGEST_PAUSE = 1.0
"""Maximum seconds between two checks for a reader that DDS has reported, but not yet connected."""

_NO_DATA = bytes(64)


class Publisher(Link, SupportsSubscribers):
    role, facing = "publishes", "subscribes"

    def __init__(self, transport: DDSCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        self._message = Message(channel.type.request)
        self._fingerprint = channel.type.fingerprint
        self._order = threading.Lock()
        self._sent = 0
        self._writer: Writer | None = None
        self._credits: Reader | None = None
        self._room = threading.Condition()
        self._limits: dict[int, int] = {}
        """For each reader that grants credit: the highest sequence number that it accepts."""
        self._limit: float = _NONE
        """The smallest of these."""
        self._greeted: set[int] = set()
        self._early: dict[int, Grant] = {}
        self._greeted_handles: set[int] = set()
        """The readers that have been greeted."""
        self._due = _NONE
        """When to check for readers that are not connected yet."""
        self._pause_between_checks = DISCOVERY_PAUSE
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
                self._sent = number  # also if the message is dropped: readers then count it as lost
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
        missing = self._writer.incompatible_policy() if self._writer else ""
        if missing and missing not in self._unmet:
            self._unmet.add(missing)
            log.warning(
                "%s: a subscriber asks for more %s than is offered here; one of another framework hears nothing. "
                "Let it ask for less, or this port offer more in its `qos`",
                self.channel.name,
                missing,
            )
        return self._due - time.monotonic()

    def visible(self) -> bool:
        same = {endpoint.handle for endpoint in self.counterparts(strict=True)}
        named = {endpoint.handle for endpoint in self.bus.endpoints.find(self.facing, self.channel.name)}
        matched = self._writer.matched() if self._writer else set()
        return bool(matched - (named - same))  # readers of other programs have no fingerprint to compare

    @property
    def has_subscribers(self) -> bool:
        return self.channel.qos.latched or bool(self._writer and self._writer.matched())

    def reached(self) -> set[int]:
        with self._looking:
            if self.closed.is_set():
                return set()
            self._greet_readers()
        return {endpoint.id for endpoint in self.counterparts() if endpoint.handle in self._greeted_handles}

    def _greet_readers(self) -> None:
        """Send new readers a sample without data, so that they know that they are connected.

        It is not delivered as a message. Latched topics do not need it: their readers get the history.
        """
        assert self._writer
        matched = self._writer.matched()
        if matched <= self._greeted_handles or self.channel.qos.latched or self._writer.greet(_NO_DATA):
            self._greeted_handles = matched
        missing = {endpoint.id for endpoint in self.counterparts()} - {
            endpoint.id for endpoint in self.counterparts() if endpoint.handle in self._greeted_handles
        }
        self._due = time.monotonic() + self._pause_between_checks if missing else _NONE
        self._pause_between_checks = min(2 * self._pause_between_checks, _LONGEST_PAUSE)
        self.bus.loop.due(self._due)

    def peers_changed(self, there: list[Endpoint]) -> None:
        self._pause_between_checks = DISCOVERY_PAUSE
        self._greet_readers()
        crediting = {endpoint.id for endpoint in there if endpoint.reliable}
        with self._room:
            for reader in self._limits.keys() - crediting:
                del self._limits[reader]
                self._greeted.discard(reader)
            for reader in crediting - self._limits.keys():
                self._limits[reader] = self._sent + INITIAL_CREDIT
                if reader in self._early:
                    self._grant(self._early[reader])
                    del self._early[reader]  # of the others, discovery may report some later
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
        """Wait until every reader's credit includes that sequence number; False at `end`."""
        about_to_block()  # this thread may be the one that receives the credit
        with self._room:
            patience = max(0.0, end - time.monotonic())
            self._room.wait_for(lambda: number <= self._limit or self.closed.is_set(), patience)
            self.check_open()
            return number <= self._limit

    def _limits_changed(self) -> None:
        """Compute `_limit`; called with the lock of `_room`."""
        self._limit = min(self._limits.values(), default=_NONE) if self._credits else _NONE
        self._room.notify_all()

    def _on_credit(self) -> list[Job]:
        assert self._credits
        for sample, info in self._credits.take(BATCH):
            if not info.valid_data:
                continue
            try:
                grant = read_grant(sample)
            except DecodeError as exc:
                self.malformed(exc)
                continue
            if grant.source != self.id:
                continue
            with self._room:
                if grant.reader in self._limits:
                    self._grant(grant)
                else:
                    self._early[grant.reader] = grant  # discovery will report the reader soon
                    if len(self._early) > BATCH:
                        del self._early[next(iter(self._early))]
        return []

    def _grant(self, grant: Grant) -> None:
        limit = grant.sequence + grant.window
        if grant.reader in self._greeted:
            limit = max(limit, self._limits[grant.reader])
        else:
            self._greeted.add(grant.reader)
            limit = max(limit, self._sent + grant.window)  # messages sent before the reader came do not count
        self._limits[grant.reader] = limit
        self._limits_changed()


class _SubscribedTopic:
    """One topic of a subscriber; with `*` it has one for each matching channel that has a publisher."""

    def __init__(self, name: str, reader: Reader, credits: Writer | None) -> None:
        self.name, self.reader, self.credits = name, reader, credits
        self.relaxed: Reader | None = None
        """A second reader, with lower requirements, for publishers whose QoS is too weak for `reader`."""
        self.common: Callable[..., Qos] = endpoint_qos
        """Makes the QoS of `relaxed`: reliable or best-effort on the wire."""
        self.no_requirements = False
        """Whether `relaxed` has no QoS requirements at all, instead of best effort only."""
        self.consumed: dict[int, int] = {}
        self.granted: dict[int, int] = {}
        """By source: the sequence number in the last credit that we sent."""

    def readers(self) -> list[Reader]:
        return [self.reader, self.relaxed] if self.relaxed else [self.reader]

    def close(self) -> None:
        for each in (*self.readers(), self.credits):
            if each:
                each.close()


_Message = tuple[_SubscribedTopic, int, int, int, Payload]
"""Topic, source, sequence number, size of the sample, and payload."""


class Subscriber(Link, SupportsSources):
    """A reliable subscriber grants credit to its publishers, and so has room for every message.

    Foreign and best-effort publishers do not use credit; a limited number of their messages may wait.
    """

    role, facing = "subscribes", "publishes"

    def __init__(self, transport: DDSCore, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._reliable = channel.qos.reliable
        self._sink = sink
        self._window = depth_of(channel.qos)
        self._intake = INTAKE if self._reliable else BATCH  # a best-effort reader keeps only the newest
        depth = MOST_WAITING if self._reliable else self._window
        consume: Sink = self._consume if self._reliable else sink
        self._lane = Lane(channel.name, consume, depth, lossy=not self._reliable, stats=self.stats)
        self._message = Message(channel.type.request)
        self._fingerprint = channel.type.fingerprint
        self._reception = Reception(channel, self.stats, self._through)
        self._ledger = Ledger(self.stats, ordered=True)
        # A writer waits for readers that are reliable on the wire. Only those get latched messages.
        self._common = best_effort_qos if channel.tap and not channel.qos.latched else endpoint_qos
        self._topics: dict[str, _SubscribedTopic] = {}
        self._greeted: set[int] = set()
        """The writers from which something has come: they are connected."""
        self._handles: set[int] = set()
        """The writers known at the last `peers_changed`."""
        self._uses_credit: dict[int, bool] = {}
        """By publisher: whether it uses credit."""
        self._put = self._consumed = 0
        self._put_bytes = self._consumed_bytes = 0
        self._most = self._window + MESSAGES_WAITING
        """Maximum number of waiting messages of publishers without credit."""
        self._grant_every = max(1, self._window // 2)
        """Number of consumed messages after which new credit is sent."""
        self._due = math.inf

    def open(self) -> None:
        self.transport.limits.check(self.channel)
        if ANY not in self.channel.name:
            self._subscribe(self.channel.name)

    def peers_changed(self, there: list[Endpoint]) -> None:
        if ANY in self.channel.name:
            names = {endpoint.channel for endpoint in there}
            names.update(self.bus.endpoints.published_by_others(self.channel.name)[:STRANGERS])
            for name in self._topics.keys() - names:
                self._unsubscribe(name)
            for name in names - self._topics.keys():
                self._subscribe(name)
        self._uses_credit = {endpoint.id: endpoint.reliable for endpoint in there}
        handles = {endpoint.handle for endpoint in there}
        self._greeted -= self._handles - handles
        self._handles = handles
        if self._reliable:
            self._greet()
        self._reception.meet(map(_source, there))
        for endpoint in there:
            self._relax_for(endpoint)

    def tick(self) -> float | None:
        if time.monotonic() >= self._due:
            with self._looking:
                if not self.closed.is_set():
                    self._greet()
        with self._looking:
            for topic in [] if self.closed.is_set() else self._topics.values():
                self._check_foreign_publishers(topic)
        return self._due - time.monotonic()

    def reached(self) -> set[int]:
        connected = set(self._greeted)
        for topic in list(self._topics.values()):
            for reader in topic.readers():
                connected |= reader.matched() & self._latched
        return {endpoint.id for endpoint in self.counterparts() if endpoint.handle in connected}

    @property
    def _latched(self) -> set[int]:
        """The writers with a history to deliver; they send no greeting."""
        return {endpoint.handle for endpoint in self.counterparts() if endpoint.latched}

    def sources(self) -> list[Source]:
        there = self.counterparts()
        ours = {each.channel for each in there}
        others = [
            Source(name, DEFAULT_QOS)
            for name, topic in list(self._topics.items())
            if name not in ours and any(reader.alive() for reader in topic.readers())
        ]
        return [*(_source(each) for each in there if self._lives(each)), *others]

    def _lives(self, publisher: Endpoint) -> bool:
        """Whether a publisher has kept its lease. Missing messages are not checked here."""
        if from_traits(publisher.traits).liveliness is Liveliness.MANUAL_BY_TOPIC:
            return True
        topic = self._topics.get(publisher.channel)
        if topic and any(reader.alive() for reader in topic.readers()):
            return True
        # After an expired lease, DDS needs the publisher's next sample to see that it is alive.
        return self.transport.local and state_of(publisher.pid) not in ("", "T", "Z", "X")

    def visible(self) -> bool:
        self.counterparts(strict=True)
        return any(reader.matched() for topic in list(self._topics.values()) for reader in topic.readers())

    def release(self) -> None:
        self._lane.close()
        for name in list(self._topics):
            self._unsubscribe(name)

    def _through(self, wrap: Callable[[Sink], Sink]) -> None:
        self._sink = wrap(self._sink)
        if not self._reliable:
            self._lane.through(wrap)

    def _subscribe(self, name: str) -> None:
        credits = None
        if self._reliable:
            about = self.about("credits", name)
            credits = self.bus.writer(f"rc/{name}Credit", credit_type(), endpoint_qos(KEEP_ALL, about))
        self._topics[name] = topic = _SubscribedTopic(name, self._reader(name, self.channel), credits)
        topic.common = self._common
        self.bus.loop.attach(topic.reader.condition, partial(self._on_message, topic))

    def _reader(self, name: str, channel: Channel, common: Callable[..., Qos] | None = None) -> Reader:
        common = common or self._common
        kind = publication_type(channel.type.name, channel.type.request)
        qos = topic_qos(channel, self.transport.limits, self.about("subscribes", name), common=common)
        return self.bus.reader(f"rc/{name}", kind, qos)

    def _unsubscribe(self, name: str) -> None:
        topic = self._topics.pop(name)
        for reader in topic.readers():
            self.bus.loop.detach(reader.condition)
        topic.close()

    def _relax_for(self, publisher: Endpoint) -> None:
        """Use the relaxed reader for a publisher whose QoS is too weak for DDS to connect it with `reader`."""
        asked = self.channel.qos
        less = [each for each in shortfalls(asked, from_traits(publisher.traits)) if each.policy != "reliability"]
        topic = self._topics.get(publisher.channel)
        if less and topic and not topic.no_requirements:
            self._make_relaxed_reader(topic, topic.common)

    def _make_relaxed_reader(
        self, topic: _SubscribedTopic, common: Callable[..., Qos], *, no_requirements: bool = True
    ) -> None:
        """Make the relaxed reader, with fewer or (`no_requirements`) no requirements."""
        if topic.relaxed:
            self.bus.loop.detach(topic.relaxed.condition)
            topic.relaxed.close()
        qos = self.channel.qos
        less = replace(self.channel, qos=QoS(qos.reliability, history=qos.history, depth=qos.depth))
        topic.relaxed = self._reader(topic.name, less if no_requirements else self.channel, common)
        topic.common, topic.no_requirements = common, no_requirements
        self.bus.loop.attach(topic.relaxed.condition, partial(self._on_relaxed_message, topic, topic.relaxed))

    def _check_foreign_publishers(self, topic: _SubscribedTopic) -> None:
        """Find foreign publishers that DDS does not connect; it reports only which policy failed."""
        for reader in topic.readers():
            missing = reader.incompatible_policy()
            unreliable = missing == "reliability"
            if unreliable and not self._reliable:  # only our own default asks for reliability
                if topic.common is not best_effort_qos:
                    self._make_relaxed_reader(
                        topic, best_effort_qos, no_requirements=topic.no_requirements
                    )  # then check again
                    return
                continue
            if not missing or (topic.no_requirements and not unreliable):
                continue  # one of ours, or connected to the relaxed reader
            log.warning(
                "%s: a foreign publisher offers less %s than this subscription requests; its messages are received, "
                "but without that guarantee",
                topic.name,
                missing,
            )
            self._make_relaxed_reader(topic, best_effort_qos if unreliable else topic.common)
            return

    def _on_message(self, topic: _SubscribedTopic) -> list[Job]:
        return self._deliver(topic, topic.reader.take(self._intake))

    def _on_relaxed_message(self, topic: _SubscribedTopic, relaxed: Reader) -> list[Job]:
        samples = relaxed.take(self._intake)
        otherwise = topic.reader.matched()  # these arrive through the main reader
        return self._deliver(topic, [each for each in samples if each[1].publication_handle not in otherwise])

    def _deliver(self, topic: _SubscribedTopic, samples: list[tuple[bytes, Any]]) -> list[Job]:
        messages = []
        for sample, info in samples:
            if info.publication_handle not in self._greeted:
                self._greeted.add(info.publication_handle)
                self._news.set()
            message = self._take(topic, sample) if info.valid_data else None
            if message is not None:
                messages.append(message)
        if not messages:
            return []
        taken = self._lane.put_all(messages)
        if taken < len(messages):
            self._give_up(messages[taken:])
        return [self._lane.drain] if self._lane.summon() else []

    def _take(self, topic: _SubscribedTopic, sample: bytes) -> Payload | _Message | None:
        """The payload to deliver, with data for credit if we grant it; None if invalid, repeated or without room."""
        try:
            start, fingerprint, source, sequence, stamp = publication_fields(sample)
            if start != START:
                raise unreadable(sample)
            if fingerprint != self._fingerprint:
                self.meet_stranger((source, fingerprint), fingerprint)
                return None
            payload = sample if self._message.plain else self._message.payload(sample)
        except (DecodeError, struct.error) as exc:
            self.malformed(exc)
            return None
        if not self._ledger.admit(source, sequence):
            return None
        if self._reliable and self._put - self._consumed >= self._window and not self._uses_credit.get(source, True):
            waiting, octets = self._put - self._consumed, self._put_bytes - self._consumed_bytes
            if waiting >= self._most or octets >= BYTES_WAITING:
                self.stats.dropped += 1
                return None
        if self._reception.on:
            payload = self._reception.admit(topic.name, stamp, payload, source, sequence)
        if not self._reliable:
            return payload
        self._put += 1
        self._put_bytes += len(sample)
        return topic, source, sequence, len(sample), payload

    def _give_up(self, messages: list[Any]) -> None:
        """Count messages for which there was no room."""
        self.stats.dropped += len(messages)
        if self._reliable:
            self._put -= len(messages)
            self._put_bytes -= sum(size for *_, size, _ in messages)

    def _consume(self, message: _Message) -> None:
        topic, source, sequence, size, payload = message
        self._consumed += 1
        self._consumed_bytes += size
        try:
            self._sink(payload)
        finally:
            if topic.credits:
                topic.consumed[source] = sequence
                if sequence - topic.granted.get(source, sequence) >= self._grant_every:
                    self._grant_credit(topic, source)

    def _greet(self) -> None:
        """Send the first credit to publishers that are connected and have none yet."""
        self._due = math.inf
        for name, topic in self._topics.items():
            assert topic.credits
            credited = self.bus.endpoints.find("credited", name)
            for gone in topic.granted.keys() - {endpoint.id for endpoint in credited}:
                del topic.granted[gone]
            waiting = [endpoint for endpoint in credited if endpoint.id not in topic.granted]
            matched = topic.credits.matched() if waiting else set()
            for endpoint in waiting:
                if endpoint.handle in matched and endpoint.fingerprint == self.channel.type.fingerprint:
                    self._grant_credit(topic, endpoint.id)
                else:
                    self._due = time.monotonic() + DISCOVERY_PAUSE
        self.bus.loop.due(self._due)

    def _grant_credit(self, topic: _SubscribedTopic, source: int) -> None:
        assert topic.credits
        consumed = topic.consumed.get(source, 0)
        topic.granted[source] = consumed
        with contextlib.suppress(TransportError):  # the link is closed
            topic.credits.write(pack_grant(Grant(self.id, source, consumed, self._window)))


def _source(publisher: Endpoint) -> Source:
    return Source(publisher.channel, from_traits(publisher.traits))
