"""Publishers and subscribers."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import zenoh

from ...contract.qos import History, Reliability, from_traits, traits
from ...errors import Timeout
from ...wire.codec import Payload
from ...wire.header import (
    Publication,
    pack_publication,
    read_publication,
)
from ..base import (
    Channel,
    Sink,
    Source,
)
from ..crew import Lane
from ..ledger import Ledger
from ..reception import TOO_OLD, Reception
from .credit import Credit
from .link import Link, Receiving, depth_of, within
from .messages import BLOCK, DROP, Message, octets
from .table import Token

if TYPE_CHECKING:
    from .transport import ZenohTransport


class Publisher(Link):
    role, facing = "publishes", "subscribes"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        qos = channel.qos
        lossless = qos.reliable or qos.history is History.KEEP_ALL
        self.traits = traits(replace(qos, reliability=Reliability.RELIABLE) if lossless else qos)
        self._lossless = lossless
        self._readers: tuple[int, dict[int, int]] = -1, {}
        self._credit = Credit(depth_of(channel), self._reliable_readers)
        self._history: deque[tuple[bytes, Payload]] = deque(maxlen=qos.depth if qos.latched else 0)
        self._order = threading.Lock()

    def open(self) -> None:
        congestion = BLOCK if self._lossless else DROP
        publisher = self.transport.session.declare_publisher(
            self.key, congestion_control=congestion, reliability=zenoh.Reliability.RELIABLE
        )
        self._publisher: zenoh.Publisher = self.declare(publisher)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        with within(self._order, self._too_slow(deadline), end):
            self.check_open()
            if not self._credit.wait(end, self.check_open, len(payload)):
                raise self._too_slow(deadline)
            fingerprint = self.channel.type.fingerprint
            header = pack_publication(fingerprint, self.id, self._credit.sent, time.time_ns())
            if self._history.maxlen:
                self._history.append((header, payload))  # first: who asks for it now may not hear the other one
            with self.using_the_session():
                self._publisher.put(payload, attachment=header)

    def visible(self) -> bool:
        status: Any = self._publisher.matching_status  # its stub says bool, which it is not
        return bool(self.counterparts(strict=True)) and bool(status.matching)

    @property
    def heard(self) -> bool:
        status: Any = self._publisher.matching_status
        return bool(self._history.maxlen) or bool(status.matching)

    def answer(self, what: str) -> Iterable[tuple[bytes, Payload]]:
        return list(self._history) if what == "history" else super().answer(what)

    def acknowledged(self, by: int, sequence: int) -> None:
        self._credit.took(by, sequence)

    def _reliable_readers(self) -> dict[int, int]:
        if not self._lossless:
            return {}
        version = self.transport.table.version
        if self._readers[0] != version:
            self._readers = version, {token.link: token.since for token in self._same() if "r" in token.traits}
        return self._readers[1]

    def _same(self) -> Iterator[Token]:
        fingerprint = self.channel.type.fingerprint
        found = self.transport.table.find(self.facing, self.channel.name)
        return (token for token in found if token.fingerprint == fingerprint)

    def _too_slow(self, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")


class Subscriber(Receiving):
    role, facing = "subscribes", "publishes"

    def __init__(self, transport: ZenohTransport, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        qos = channel.qos
        self._lossless = qos.reliable or qos.history is History.KEEP_ALL
        self.traits = traits(replace(qos, reliability=Reliability.RELIABLE) if self._lossless else qos)
        self._ledger = Ledger(self.stats, ordered=True)
        self.lane = Lane(
            channel.name, lambda p: sink(p.to_bytes()), depth_of(channel), lossy=not self._lossless, stats=self.stats
        )
        self._reception = Reception(channel, self.stats, self.lane.through)
        self._channels: dict[int, str] = {}
        """By publisher."""
        self._catching_up: dict[int, list[Message]] = {}
        self._caught_up: set[int] = set()
        self._heard: dict[int, int] = {}

    def look(self) -> None:
        there = {token.link: token.channel for token in self.counterparts()}
        self._channels = there
        self._reception.meet(self.sources())
        if self.channel.qos.latched:
            with self._taking:
                self._caught_up &= there.keys()
                for source in there:
                    self._catch_up(source)

    def sources(self) -> list[Source]:
        return [Source(token.channel, from_traits(token.traits)) for token in self.counterparts()]

    def take(self, message: Message) -> tuple[int, int] | None:
        header = read_publication(octets(message.header))
        if header.fingerprint != self.channel.type.fingerprint:
            self.meet_stranger(header.source, header.fingerprint)
            return None
        if self.channel.qos.latched and not self._is_next(header, message):
            return None
        if self._ledger.admit(header.source, header.sequence):
            payload = message.payload
            if self._reception.on:
                name = self._channels.get(header.source, self.channel.name)
                payload = self._reception.admit(name, header.stamp, payload)
            if payload is not TOO_OLD:
                self.lane.put(payload)
        return (header.source, header.sequence) if self._lossless else None

    def _is_next(self, header: Publication, message: Message) -> bool:
        """Whether all that precedes a latched message was heard, and itself was not."""
        source = header.source
        if source not in self._caught_up:
            self._catch_up(source)
            self._catching_up[source].append(message)
            return False
        new = header.sequence > self._heard.get(source, 0)
        if new:
            self._heard[source] = header.sequence
        return new

    def _catch_up(self, source: int) -> None:
        """Have a publisher's history fetched; what else comes from it has to wait until it is there."""
        if source not in self._caught_up and source not in self._catching_up:
            self._catching_up[source] = []
            self.transport.do(partial(self._fetch, source))

    def _fetch(self, source: int) -> None:
        missed = self.transport.inquire(source, "history")
        with self._taking:
            self._caught_up.add(source)
            self._inbox.put_back([*missed, *self._catching_up.pop(source, ())])
        self.schedule()
