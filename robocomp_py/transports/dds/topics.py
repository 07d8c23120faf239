"""Publishers and subscribers."""

from __future__ import annotations

import contextlib
import logging
import struct
import threading
import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from ...contract.qos import Durability
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
    TypeRef,
    step_aside,
)
from ..crew import Job, Lane
from ..ledger import Ledger
from .bus import Reader, Writer
from .endpoints import Endpoint
from .link import BATCH, INTAKE, KEEP_ALL, SOON, Link, depth_of, endpoint_qos, enter, topic_qos
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


class Publisher(Link):
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
        self._writer = self.bus.writer(f"rc/{channel.name}", kind, topic_qos(channel, self.about()))
        if channel.qos.reliable:
            about = self.about("credited")
            self._credits = self.bus.reader(f"rc/{channel.name}Credit", credit_type(), endpoint_qos(KEEP_ALL, about))
            self.bus.loop.attach(self._credits.condition, self._on_credit)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        sample = self._message.sample(payload)
        enter(self, self._order, deadline)
        try:
            self.check_open()
            if self._credits and not self._await_credit(self._sent + 1, end):
                raise Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")
            fill_publication(sample, 0, START, self._fingerprint, self.id, self._sent + 1, time.time_ns())
            if self._credits is None:
                self._sent += 1  # whether it gets away or not: who hears the next one knows what is missing
                self.stats.dropped += not self._written(memoryview(sample)[:BEFORE_TAIL])
            elif self._written_within(memoryview(sample)[:BEFORE_TAIL], end):
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


class Subscriber(Link):
    """A reliable one takes all that comes in, for its publishers know how much it takes (`Credit`).

    Others than ours do not, nor do those that publish best effort; of theirs, only so many may wait.
    """

    role, facing = "subscribes", "publishes"

    def __init__(self, transport: DDSTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self._reliable = channel.qos.reliable
        self._sink = sink
        self._window = depth_of(channel)
        self._intake = INTAKE if self._reliable else BATCH  # the reader of the others keeps the newest ones only
        depth = MOST_WAITING if self._reliable else self._window
        self._lane = Lane(channel.name, self._consume, depth, lossy=not self._reliable, stats=self.stats)
        self._message = Message(channel.type.request)
        self._fingerprint = channel.type.fingerprint
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
            credits = self.bus.writer(f"rc/{name}Credit", credit_type(), endpoint_qos(KEEP_ALL, about))
        self._heard[name] = heard = _Heard(self._reader(name, self.channel), credits)
        self.bus.loop.attach(heard.reader.condition, partial(self._on_message, heard))

    def _reader(self, name: str, channel: Channel) -> Reader:
        kind = publication_type(channel.type.name, channel.type.request)
        return self.bus.reader(f"rc/{name}", kind, topic_qos(channel, self.about("subscribes", name)))

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
            start, fingerprint, source, sequence, _ = publication_fields(sample)
            if start != START:
                raise unreadable(sample)
            if fingerprint != self._fingerprint:
                self.report_mismatch(source, TypeRef("", fingerprint))
                return False
            payload = sample if self._message.plain else self._message.payload(sample)
        except (DecodeError, struct.error) as exc:
            self.malformed(exc)
            return False
        if not self._ledger.admit(source, sequence):
            return False
        if self._reliable:
            waiting = self._put - self._consumed
            if waiting >= self._window + MESSAGES_WAITING and not self._counting.get(source, True):
                self.stats.dropped += 1
                return False
        if self._lane.put((heard, source, sequence, payload)):
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
