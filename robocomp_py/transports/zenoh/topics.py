"""The links of publications: publisher and subscriber."""

from __future__ import annotations

import logging
import struct
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import zenoh

from ...contract.qos import from_traits, traits
from ...errors import Timeout
from ...wire.codec import Payload
from ...wire.header import (
    VERSION,
    publication_fields,
    publications_of,
)
from ...wire.names import ANY
from ..base import (
    Channel,
    Heard,
    Sink,
    Source,
    SupportsSources,
    SupportsSubscribers,
    depth_of,
)
from ..credit import Credit
from ..ledger import Ledger
from ..limits import BYTES_AHEAD, MOST_AHEAD, PARTS
from ..reception import HISTORY_TRIES, Reception
from .core import TICK
from .link import INBOX, Link
from .messages import BLOCK, DROP, Message
from .reader import Reader
from .table import Token

if TYPE_CHECKING:
    from .core import ZenohCore


log = logging.getLogger("robocomp.transport.zenoh")

_ACKNOWLEDGE_BYTES = BYTES_AHEAD // PARTS
"""Unacknowledged bytes after which a subscriber acknowledges at once."""

_SLOW_TICK = 0.01
"""Seconds between two checks of a slow sink."""

_BEFORE_TOKEN, _LEFT = 0, -1
"""Values in `Subscriber._caught_up`: the publisher's messages came before its token; it left during the inquiry."""

_PROBE_AFTER = 0.5
"""Seconds that a publisher waits for acknowledgements before it checks whether its subscribers exist."""

_REFUSED = zenoh.ZError, RuntimeError
"""The exceptions of a Zenoh publisher that is undeclared, or is being undeclared."""


class Publisher(Link, SupportsSubscribers):
    role, facing = "publishes", "subscribes"

    def __init__(self, transport: ZenohCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        qos = channel.qos
        lossless = qos.reliable
        ahead = min(depth_of(channel.qos), MOST_AHEAD)
        self.traits = f"{traits(qos)}w{ahead}" if lossless else traits(qos)
        self._lossless = lossless
        self._readers: tuple[int, dict[int, int]] = -1, {}
        self._credit = Credit(ahead, self._reliable_readers)
        self._history: deque[tuple[bytes, Payload]] = deque(maxlen=qos.depth if qos.latched else 0)
        self._latched = qos.latched
        self._probing = False
        self._order = threading.Lock()
        self._header = publications_of(b"", channel.type.fingerprint, self.id)

    def open(self) -> None:
        congestion = BLOCK if self._lossless else DROP
        publisher = self.transport.session.declare_publisher(
            self.key, congestion_control=congestion, reliability=zenoh.Reliability.RELIABLE
        )
        self._publisher: zenoh.Publisher = self.declare(publisher)
        self._put = publisher.put

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        order, credit = self._order, self._credit
        begun = 0.0
        if not order.acquire(blocking=False):
            begun = time.monotonic()
            self.take_turn(order, deadline)
        try:
            if not credit.claim(len(payload)):
                self._wait_for_credit((begun or time.monotonic()) + deadline, len(payload), deadline)
            header = self._header(credit.sent, time.time_ns())
            if self._latched:
                self.check_open()
                self._history.append((header, payload))  # first: a new subscriber may miss the publication
            self._put(payload, attachment=header)  # refuses if the link is closed
        except _REFUSED as exc:
            raise self.failed(exc) from exc
        finally:
            order.release()

    def _wait_for_credit(self, end: float, size: int, deadline: float) -> None:
        self.check_open()
        if self._credit.wait(min(end, time.monotonic() + _PROBE_AFTER), self.check_open, size):
            return
        if not self._probing:
            self._probing = True
            self.transport.do(self._probe)
        if not self._credit.wait(end, self.check_open, size):
            raise self._too_slow(deadline)

    def _probe(self) -> None:
        """Check whether the subscribers still exist."""
        try:
            for token in self._same():
                self.transport.confirm(token)
        finally:
            self._probing = False

    def visible(self) -> bool:
        return bool(self.counterparts(strict=True)) and self._matches()

    def connected(self) -> bool:
        self.wait_for_earlier()
        return not self.counterparts() or self._matches()

    @property
    def has_subscribers(self) -> bool:
        return bool(self._history.maxlen) or self._matches()

    def answer(self, what: str) -> Iterable[tuple[bytes, Payload]]:
        return list(self._history) if what == "history" else super().answer(what)

    def acknowledged(self, by: int, sequence: int) -> None:
        self._credit.took(by, sequence)

    def _matches(self) -> bool:
        try:
            status: Any = self._publisher.matching_status  # its type stub wrongly says bool
            return bool(status.matching)
        except _REFUSED as exc:
            raise self.failed(exc) from exc

    def _reliable_readers(self) -> dict[int, int]:
        if not self._lossless:
            return {}
        version = self.transport.table.version
        if self._readers[0] != version:
            self._readers = version, {token.link: token.since for token in self._same() if "r" in token.traits}
        return self._readers[1]

    def _same(self) -> Iterator[Token]:
        """The tokens of subscribers with the same contract."""
        fingerprint = self.channel.type.fingerprint
        return (token for token in self.faced() if token.fingerprint == fingerprint)

    def _too_slow(self, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")


class Subscriber(Link, SupportsSources):
    role, facing = "subscribes", "publishes"

    def __init__(self, transport: ZenohCore, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        qos = channel.qos
        self._lossless = qos.reliable
        self._latched = qos.latched
        self._looking = threading.Lock()
        self.traits = traits(qos)
        self._fingerprint = channel.type.fingerprint
        self._ledger = Ledger(self.stats, ordered=True)
        self._reader = Reader(
            channel.name,
            self._admit,
            _headed(sink) if channel.headed else lambda payload: sink(payload.to_bytes()),
            depth_of(channel.qos),
            lossy=not self._lossless,
            stats=self.stats,
        )
        self._reader.settle = self._acknowledge
        self._reception = Reception(channel, self.stats, self._reader.wrap_sink)
        self._channels: dict[int, str] = {}
        """The channel of each publisher."""
        self._unacknowledged: dict[int, list[int]] = {}
        """For each sender: the last sequence number, the unacknowledged messages and bytes, and the number of messages
        after which to acknowledge."""
        self._ahead: dict[int, int] = {}
        """Maximum number of unacknowledged messages of each sender."""
        self._lost: dict[int, int] = {}
        """The number of lost messages of each reliable publisher."""
        self._catching_up: dict[int, deque[Any]] = {}
        self._caught_up: dict[int, int] = {}
        """The `since` of each publisher whose history was fetched; or `_BEFORE_TOKEN` or `_LEFT`."""
        self._since: dict[int, int] = {}
        """The `since` of each visible publisher; it changes if the publisher leaves and comes back."""
        self._heard: dict[int, int] = {}
        self._connected: set[tuple[int, int]] = set()
        """The publishers, with their `since`, that have answered since we subscribed."""

    def open(self) -> None:
        origin = zenoh.Locality.REMOTE if ANY in self.channel.name else zenoh.Locality.ANY
        subscribe = self.transport.session.declare_subscriber
        subscription = self.declare(subscribe(self.key, self._reader.channel(), allowed_origin=origin))
        self._reader.start(subscription.handler)  # a subscription cannot be undeclared during its own `recv`

    def look(self) -> bool:
        with self._looking:  # an interrupted thread must not overwrite a newer result
            self._look()
        self.has_news()
        return True

    def _look(self) -> None:
        tokens = self.counterparts()
        there = {token.link for token in tokens}
        reliable = [token.link for token in tokens if "w" in token.traits] if self._lossless else []
        self._reception.meet(self.sources())
        with self._reader.lock:  # which `_admit` holds
            self._channels = {token.link: token.channel for token in tokens}
            self._ahead = {token.link: token.ahead for token in tokens}
            self._lost = {link: self._lost.get(link, 0) for link in reliable}
            self._unacknowledged = {
                source: unacknowledged for source, unacknowledged in self._unacknowledged.items() if source in there
            }
            for source, unacknowledged in self._unacknowledged.items():
                unacknowledged[3] = self._acknowledge_every(source)
        if self._latched:
            with self._reader.lock:
                self._since = {token.link: token.since for token in tokens}
                self._caught_up = {
                    source: since
                    for source, since in self._since.items()
                    if self._caught_up.get(source) in (_BEFORE_TOKEN, since)
                }
                for source in there:
                    self._catch_up(source)

    def wait_connected(self, timeout: float) -> bool:
        """See `base.SupportsConnected`.

        Our subscription was sent before the question, on the same path: a publisher that answers knows of both.
        """
        end = time.monotonic() + timeout
        self.wait_for_earlier()
        while True:
            self.check_open()
            self._news.clear()  # before the look, so that later news are not missed
            there = {(token.link, token.since) for token in self.counterparts() if not self.transport.is_own(token)}
            connected = self._connected & there  # a copy: several threads may wait
            for publisher in there - connected:
                self.check_open()
                answers, _ = self.transport.inquire(publisher[0], "text")
                if answers:
                    connected.add(publisher)
                if time.monotonic() >= end:
                    break
            self._connected = connected
            self.check_open()
            if there <= connected:
                return True
            if time.monotonic() >= end:
                return False
            self.await_news(end)  # a publisher may just be leaving

    def sources(self) -> list[Source]:
        return [Source(token.channel, from_traits(token.traits)) for token in self.counterparts()]

    def tick(self) -> float | None:
        held_up = self._reader.replace_if_slow()
        if held_up:
            self._acknowledge()
        return _SLOW_TICK if held_up else TICK

    def release(self) -> None:
        self._reader.close()

    def _admit(self, message: zenoh.Sample | Message) -> Any:
        try:
            header = message.attachment
            data = b"" if header is None else header.to_bytes()
            version, fingerprint, source, sequence, stamp = publication_fields(data)
        except struct.error as exc:
            self.malformed(exc)
            return None
        if version != VERSION:
            self.malformed(f"its header has version {version}")
            return None
        if fingerprint != self._fingerprint:
            self.meet_stranger(source, fingerprint)
            return None
        if self._latched and not self._is_next(source, sequence, message):
            return None
        payload = message.payload
        if self._lossless:
            self._reader.waits = source in self._lost
            unacknowledged = self._unacknowledged.get(source)
            if unacknowledged is None:
                unacknowledged = self._unacknowledged[source] = [0, 0, 0, self._acknowledge_every(source)]
            unacknowledged[0] = sequence
            unacknowledged[1] += 1
            unacknowledged[2] += len(payload)
            if unacknowledged[1] >= unacknowledged[3] or unacknowledged[2] >= _ACKNOWLEDGE_BYTES:
                self._reader.must_settle = True
        lost = self.stats.lost
        if not self._ledger.admit(source, sequence):
            return None
        if self.stats.lost != lost and source in self._lost:
            self._count_lost(source, self.stats.lost - lost)
        if not self._reception.on:
            return payload
        name = self._channels.get(source, self.channel.name)
        return self._reception.admit(name, stamp, payload, source, sequence)

    def _count_lost(self, source: int, count: int) -> None:
        """Log and count lost messages of a reliable publisher; a lost connection is the cause."""
        if self._lost[source] == 0:
            log.error(
                "%s: lost %d messages of a reliable publisher: the connection failed (further ones are only counted)",
                self._channels.get(source, self.channel.name),
                count,
            )
        self._lost[source] += count

    def _acknowledge_every(self, source: int) -> int:
        """Number of a sender's messages after which they are acknowledged."""
        return -(-self._ahead.get(source, 1) // PARTS)

    def _acknowledge(self) -> None:
        taken = {}
        with self._reader.lock:
            for source, unacknowledged in self._unacknowledged.items():
                if unacknowledged[1]:
                    taken[source] = unacknowledged[0]
                    unacknowledged[1] = unacknowledged[2] = 0
        self.transport.acknowledge(taken, self.id)

    def _is_next(self, source: int, sequence: int, message: Any) -> bool:
        """Whether a latched message is to be delivered now: after its publisher's history, and only once."""
        if source not in self._caught_up:
            self._catch_up(source)
            self._catching_up[source].append(message)
            return False
        new = sequence > self._heard.get(source, 0)
        if new:
            self._heard[source] = sequence
        return new

    def _catch_up(self, source: int) -> None:
        """Have a publisher's history fetched; its later messages wait until then."""
        if source not in self._caught_up and source not in self._catching_up:
            self._catching_up[source] = deque(maxlen=INBOX)
            self.transport.do(partial(self._fetch, source))

    def _fetch(self, source: int, tries: int = HISTORY_TRIES) -> None:
        since, name = self._since.get(source), self._channels.get(source, self.channel.name)
        missed, whole = self.transport.inquire(source, "history", name)

        def messages() -> list[Any]:
            now = self._since.get(source)
            if now is not None and now != since:  # it came back: the inquiry may have missed it
                self.transport.do(partial(self._fetch, source))
                return []
            if now is not None and not whole and not self.closed.is_set():  # it was too busy
                if tries > 1:
                    self.transport.do(partial(self._fetch, source, tries - 1))
                    return []
                log.warning("%s: not all latched messages of its publisher came in time", name)
            self._caught_up[source] = now or (_BEFORE_TOKEN if since is None else _LEFT)
            return [*missed, *self._catching_up.pop(source, ())]  # `_admit` drops duplicates

        self._reader.feed(messages)


def _headed(sink: Sink) -> Sink:
    """The sink of a channel that is `headed`, as the reader calls it: with payloads of Zenoh's type."""

    def deliver(heard: Heard) -> None:
        sink(heard._replace(payload=heard.payload.to_bytes()))

    return deliver
