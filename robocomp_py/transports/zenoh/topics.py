"""Publishers and subscribers."""

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
    Sink,
    Source,
    SupportsHeard,
    SupportsSources,
    depth_of,
)
from ..credit import Credit
from ..ledger import Ledger
from ..limits import BYTES_AHEAD, MOST_AHEAD, PARTS
from ..reception import HISTORY_TRIES, Reception
from .link import INBOX, TICK, Link
from .messages import BLOCK, DROP, Message
from .reader import Reader
from .table import Token

if TYPE_CHECKING:
    from .transport import ZenohTransport


log = logging.getLogger("robocomp.transport.zenoh")

_MUCH = BYTES_AHEAD // PARTS
"""And when it is so many bytes."""

_LOOK = 0.01
"""Seconds until a sink that takes long is looked at again."""

_EARLY, _WENT = 0, -1
"""Of a publisher that was heard before it was told of; and of one that went while it was asked what it had said."""

_BEFORE_DOUBT = 0.5
"""Seconds that a publisher waits for its subscribers until it asks whether they are there."""

_REFUSED = zenoh.ZError, RuntimeError
"""What a publisher of Zenoh raises once it is undeclared, and while it is being."""


class Publisher(Link, SupportsHeard):
    role, facing = "publishes", "subscribes"

    def __init__(self, transport: ZenohTransport, channel: Channel) -> None:
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
        self._doubting = False
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
                self._history.append((header, payload))  # first: who asks for it now may not hear the other one
            self._put(payload, attachment=header)  # refuses if the link is closed
        except _REFUSED as exc:
            raise self.failed(exc) from exc
        finally:
            order.release()

    def _wait_for_credit(self, end: float, size: int, deadline: float) -> None:
        self.check_open()
        if self._credit.wait(min(end, time.monotonic() + _BEFORE_DOUBT), self.check_open, size):
            return
        if not self._doubting:
            self._doubting = True
            self.transport.do(self._doubt)
        if not self._credit.wait(end, self.check_open, size):
            raise self._too_slow(deadline)

    def _doubt(self) -> None:
        """Find out whether those we wait for are there at all."""
        try:
            for token in self._same():
                self.transport.confirm(token)
        finally:
            self._doubting = False

    def visible(self) -> bool:
        return bool(self.counterparts(strict=True)) and self._matches()

    def connected(self) -> bool:
        self.meet_earlier()
        return not self.counterparts() or self._matches()

    @property
    def heard(self) -> bool:
        return bool(self._history.maxlen) or self._matches()

    def answer(self, what: str) -> Iterable[tuple[bytes, Payload]]:
        return list(self._history) if what == "history" else super().answer(what)

    def acknowledged(self, by: int, sequence: int) -> None:
        self._credit.took(by, sequence)

    def _matches(self) -> bool:
        try:
            status: Any = self._publisher.matching_status  # its stub says bool, which it is not
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
        fingerprint = self.channel.type.fingerprint
        return (token for token in self.faced() if token.fingerprint == fingerprint)

    def _too_slow(self, deadline: float) -> Timeout:
        return Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")


class Subscriber(Link, SupportsSources):
    role, facing = "subscribes", "publishes"

    def __init__(self, transport: ZenohTransport, channel: Channel, sink: Sink) -> None:
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
            lambda payload: sink(payload.to_bytes()),
            depth_of(channel.qos),
            lossy=not self._lossless,
            stats=self.stats,
        )
        self._reader.settle = self._acknowledge
        self._reception = Reception(channel, self.stats, self._reader.through)
        self._channels: dict[int, str] = {}
        """By publisher."""
        self._untold: dict[int, list[int]] = {}
        """Of each sender the last number that was taken, how many messages and bytes it has not been told of, and how
        many messages are worth telling."""
        self._ahead: dict[int, int] = {}
        """How many messages each sender may be ahead."""
        self._lost: dict[int, int] = {}
        """Of each reliable publisher, which waits for us, how many of its messages did not come."""
        self._catching_up: dict[int, deque[Any]] = {}
        self._caught_up: dict[int, int] = {}
        """Of each publisher whose history was heard, since when it was there then; or one of those below."""
        self._since: dict[int, int] = {}
        """Of each publisher that is there, since when: any number that is another one if it went and came back."""
        self._heard: dict[int, int] = {}
        self._connected: set[tuple[int, int]] = set()
        """Publishers that have answered since we subscribed, and since when they were there."""

    def open(self) -> None:
        from_whom = zenoh.Locality.REMOTE if ANY in self.channel.name else zenoh.Locality.ANY
        subscribe = self.transport.session.declare_subscriber
        subscription = self.declare(subscribe(self.key, self._reader.channel(), allowed_origin=from_whom))
        self._reader.start(subscription.handler)  # not its own `recv`, during which it cannot be undeclared

    def look(self) -> bool:
        with self._looking:  # or who looked first, and was interrupted, would have the last word
            self._look()
        self.has_news()
        return True

    def _look(self) -> None:
        tokens = self.counterparts()
        there = {token.link for token in tokens}
        self._channels = {token.link: token.channel for token in tokens}
        self._ahead = {token.link: token.ahead for token in tokens}
        reliable = [token.link for token in tokens if "w" in token.traits] if self._lossless else []
        self._lost = {link: self._lost.get(link, 0) for link in reliable}
        self._reception.meet(self.sources())
        with self._reader.lock:
            self._untold = {source: untold for source, untold in self._untold.items() if source in there}
            for source, untold in self._untold.items():
                untold[3] = self._many(source)
        if self._latched:
            with self._reader.lock:
                self._since = {token.link: token.since for token in tokens}
                self._caught_up = {
                    source: since
                    for source, since in self._since.items()
                    if self._caught_up.get(source) in (_EARLY, since)
                }
                for source in there:
                    self._catch_up(source)

    def wait_connected(self, timeout: float) -> bool:
        """See `base.SupportsConnected`.

        Our subscription was sent before the question, on the same path: a publisher that answers knows of both.
        """
        end = time.monotonic() + timeout
        self.meet_earlier()
        there = {(token.link, token.since) for token in self.counterparts() if not self.transport.is_own(token)}
        self._connected &= there
        for publisher in there - self._connected:
            self.check_open()
            answers, _ = self.transport.inquire(publisher[0], "text")
            if answers:
                self._connected.add(publisher)
            if time.monotonic() >= end:
                break
        self.check_open()
        return there <= self._connected

    def sources(self) -> list[Source]:
        return [Source(token.channel, from_traits(token.traits)) for token in self.counterparts()]

    def tick(self) -> float | None:
        held_up = self._reader.relieve()
        if held_up:
            self._acknowledge()
        return _LOOK if held_up else TICK

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
            untold = self._untold.get(source)
            if untold is None:
                untold = self._untold[source] = [0, 0, 0, self._many(source)]
            untold[0] = sequence
            untold[1] += 1
            untold[2] += len(payload)
            if untold[1] >= untold[3] or untold[2] >= _MUCH:
                self._reader.owing = True
        lost = self.stats.lost
        if not self._ledger.admit(source, sequence):
            return None
        if self.stats.lost != lost and source in self._lost:
            self._miss(source, self.stats.lost - lost)
        if not self._reception.on:
            return payload
        return self._reception.admit(self._channels.get(source, self.channel.name), stamp, payload)

    def _miss(self, source: int, count: int) -> None:
        """What should not be lost was: neither side could prevent it, and this one is the first to know."""
        if self._lost[source] == 0:
            log.error(
                "%s: %d messages of its reliable publisher were lost, as the connection was (more are only counted)",
                self._channels.get(source, self.channel.name),
                count,
            )
        self._lost[source] += count

    def _many(self, source: int) -> int:
        """After so many of its messages a sender is told that they were taken."""
        return -(-self._ahead.get(source, 1) // PARTS)

    def _acknowledge(self) -> None:
        taken = {}
        with self._reader.lock:
            for source, untold in self._untold.items():
                if untold[1]:
                    taken[source] = untold[0]
                    untold[1] = untold[2] = 0
        self.transport.acknowledge(taken, self.id)

    def _is_next(self, source: int, sequence: int, message: Any) -> bool:
        """Whether all that precedes a latched message was heard, and itself was not."""
        if source not in self._caught_up:
            self._catch_up(source)
            self._catching_up[source].append(message)
            return False
        new = sequence > self._heard.get(source, 0)
        if new:
            self._heard[source] = sequence
        return new

    def _catch_up(self, source: int) -> None:
        """Have a publisher's history fetched; what else comes from it has to wait until it is there."""
        if source not in self._caught_up and source not in self._catching_up:
            self._catching_up[source] = deque(maxlen=INBOX)
            self.transport.do(partial(self._fetch, source))

    def _fetch(self, source: int, tries: int = HISTORY_TRIES) -> None:
        since, name = self._since.get(source), self._channels.get(source, self.channel.name)
        missed, whole = self.transport.inquire(source, "history", name)

        def all_of_it() -> list[Any]:
            now = self._since.get(source)
            if now is not None and now != since:  # it came back meanwhile, and may not have been asked
                self.transport.do(partial(self._fetch, source))
                return []
            if now is not None and not whole and not self.closed.is_set():  # it was too busy
                if tries > 1:
                    self.transport.do(partial(self._fetch, source, tries - 1))
                    return []
                log.warning("%s: not all that its publisher has latched came in time", name)
            self._caught_up[source] = now or (_EARLY if since is None else _WENT)
            return [*missed, *self._catching_up.pop(source, ())]  # what came before it asked comes to nothing

        self._reader.feed(all_of_it)
