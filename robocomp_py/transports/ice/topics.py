"""The links of publications: publisher and subscriber, with IceStorm between them.

IceStorm keeps no history and does not wait for slow subscribers. So a subscriber fetches latched messages from their
publisher, and a reliable subscriber acknowledges messages to it (`Credit`). Both go to the publisher's `TopicService`,
listed in the directory. Subscribers on other hosts cannot do this. For them, reliable means that IceStorm acknowledges
each message, and delivers them one by one.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from ...contract.qos import from_traits
from ...errors import Closed, Timeout, TransportError
from ...wire.codec import Payload
from ...wire.header import pack_publication, random_id
from .. import iceoptions
from ..base import Channel, Sink, depth_of
from ..credit import Credit
from ..directory_transport import DirectoryLink
from ..leader_followers import Job, Lane
from ..limits import BYTES_AHEAD, MOST_AHEAD, PARTS
from ..reception import HISTORY_TRIES, Reception
from ..topics import SubscribingLink
from . import library
from .messages import RC
from .storm_client import Topic
from .topic_service import RC_CHANNEL, Header, SharedSubscription

if TYPE_CHECKING:
    from .core import IceCore

log = logging.getLogger("robocomp.transport.ice")

WAITING = 10_000
"""Maximum number of messages that wait at a reliable subscriber. Only publishers without credit reach it."""

_FEWEST_UNSENT = 8
"""Minimum of the limit of messages that are being sent to IceStorm."""

_MOST_UNSENT_BYTES = 64 * 1024 * 1024
"""No more is sent while this many bytes are being sent; the last message may be of any size."""

_MOST_UNKNOWN = 1000
"""Maximum number of publishers outside the directory whose acknowledgements are kept."""

_READERS = 0.02
"""Seconds for which the list of reliable readers is cached."""


class Publisher(DirectoryLink["IceCore"]):
    role, facing = "publishes", "subscribes"
    _topic: Topic | None = None

    def __init__(self, transport: IceCore, channel: Channel) -> None:
        super().__init__(transport, channel)
        qos = channel.qos
        self.id = random_id()
        self._lossless = qos.reliable
        self._operation = iceoptions.operation_of(channel.name)
        self._mode = library.IDEMPOTENT if channel.idempotent else library.NORMAL
        self._fingerprint = channel.type.fingerprint
        self.ahead = min(depth_of(qos), MOST_AHEAD)
        self._credit = Credit(self.ahead, self._reliable_readers)
        self._readers: tuple[float, dict[int, int]] = 0.0, {}
        self._history: deque[tuple[bytes, bytes]] = deque(maxlen=qos.depth if qos.latched else 0)
        self._unsent: deque[tuple[Any, int]] = deque()
        self._unsent_bytes = 0
        self._most_unsent = max(self.ahead, _FEWEST_UNSENT)
        self._order = threading.Lock()

    def open(self) -> None:
        storm_client = self.transport.topic_service.storm_client
        with storm_client.using(self.transport.options.topic_of(self.channel.name)) as topic:
            storm_client.reach(topic)
        self._topic = topic
        topic_service = self.transport.topic_service.open()
        self.transport.topic_service.publishers[self.id] = self
        self.announce(f"{self.id:016x} {self.ahead} {topic_service}")

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        if not self._order.acquire(blocking=False):
            self.take_turn(self._order, deadline)
        try:
            self.check_open()
            data = payload if type(payload) is bytes else bytes(payload)
            if len(data) > self.transport.limit:
                raise TransportError(
                    f"{self.channel.name}: a message of {len(data)} bytes; {self.transport.limit} are allowed here "
                    "(transports.ice.message_size_max)"
                )
            if not (self._credit.claim(len(data)) or self._credit.wait(end, self.check_open, len(data))):
                raise Timeout(f"{self.channel.name}: a subscriber did not keep up for {deadline:g} s")
            header = pack_publication(self._fingerprint, self.id, self._credit.sent, time.time_ns())
            if self._history.maxlen:
                self._history.append((header, data))  # first: a new subscriber may miss the publication
            context = {RC: header.hex(), RC_CHANNEL: self.channel.name}
            if self._lossless:
                self._send_acknowledged(data, context, end, deadline)
            else:
                self._send_unacknowledged(data, context)
        finally:
            self._order.release()

    def visible(self) -> bool:
        topic = self._topic
        if topic is None or topic.publisher is None:
            return False
        if any(self.transport.directory.alive(member.id) for member, _ in self.counterparts(strict=True)):
            return True
        self.transport.topic_service.storm_client.look_soon()
        return topic.foreign_subscribers

    def release(self) -> None:
        self.transport.topic_service.publishers.pop(self.id, None)
        if self._topic:
            self.transport.topic_service.storm_client.leave(self._topic)

    # Called by the topic service.

    def took(self, reader: int, sequence: int) -> None:
        self._credit.took(reader, sequence)

    def history(self) -> list[tuple[bytes, bytes]]:
        return list(self._history)

    # Sending.

    def _send_unacknowledged(self, data: bytes, context: Mapping[str, str]) -> None:
        """Publish without acknowledgement, if that is possible without waiting."""
        assert self._topic
        unsent, proxy = self._unsent, self._topic.oneway
        while unsent and unsent[0][0].done():
            self._unsent_bytes -= unsent.popleft()[1]
        if proxy is None or len(unsent) >= self._most_unsent or self._unsent_bytes >= _MOST_UNSENT_BYTES:
            self.stats.dropped += 1
            return
        future = self._invoke(proxy, data, context)
        if not library.gone(future):
            unsent.append((future, len(data)))
            self._unsent_bytes += len(data)

    def _send_acknowledged(self, data: bytes, context: Mapping[str, str], end: float, deadline: float) -> None:
        """Publish with IceStorm's acknowledgement. A message that may have arrived is not sent again."""
        assert self._topic
        while True:
            proxy = self._await_storm(end, deadline)
            future = self._invoke(proxy, data, context)
            try:
                future.result(max(0.001, end - time.monotonic()))
                return
            except library.NotServed:  # a restarted IceStorm, which does not have the topic yet
                self.transport.topic_service.storm_client.lost()
                self._topic.publisher = None
            except library.AnyTimeout as exc:
                future.cancel()
                raise Timeout(
                    f"{self.channel.name}: IceStorm did not accept the publication for {deadline:g} s"
                ) from exc
            except library.LocalException as exc:
                self.transport.topic_service.storm_client.lost()
                raise self._failed(exc) from exc

    def _await_storm(self, end: float, deadline: float) -> Any:
        assert self._topic
        while (proxy := self._topic.publisher) is None:
            self.check_open()
            if time.monotonic() >= end:
                raise Timeout(
                    f"{self.channel.name}: for {deadline:g} s, {self.transport.topic_service.storm_client.absent()}"
                )
            self.closed.wait(0.01)
        return proxy

    def _invoke(self, proxy: Any, data: bytes, context: Mapping[str, str]) -> Any:
        try:
            return proxy.ice_invokeAsync(self._operation, self._mode, data, context)
        except library.LocalException as exc:
            raise self._failed(exc) from exc

    def _failed(self, exc: Any) -> TransportError:
        if self.closed.is_set() or self.transport.closed:
            return Closed(f"{self.channel.name}: the link is closed")
        return TransportError(f"{self.channel.name}: publishing: {library.why(exc)}")

    def _reliable_readers(self) -> dict[int, int]:
        if not self._lossless:
            return {}
        now = time.monotonic()
        if now - self._readers[0] >= _READERS:
            self._readers = now, dict(self._find_readers())
        return self._readers[1]

    def _find_readers(self) -> Iterator[tuple[int, int]]:
        """Readers that acknowledge, each with an epoch, which changes when messages in transit may be lost."""
        epoch = self._topic.epoch if self._topic else 0
        for member, entry in self.counterparts():
            told = _reader(entry.address)
            if told and from_traits(entry.traits).reliable and self.transport.directory.alive(member.id):
                yield told[0], epoch << 32 | told[1]


class Subscriber(SubscribingLink["IceCore"]):
    _hearing: SharedSubscription | None = None

    def __init__(self, transport: IceCore, channel: Channel, sink: Sink) -> None:
        self._sink = sink
        super().__init__(transport, channel, sink)
        self.id = random_id()
        self.operation = iceoptions.operation_of(channel.name)
        self._latched = channel.qos.latched
        self._looking = threading.Lock()
        self._taking = threading.RLock()
        self._publishers: dict[int, _PublisherEntry] = {}
        """Publishers by id."""
        self._unacknowledged: dict[int, _Unacknowledged] = {}
        """What is not acknowledged yet, by publisher."""
        self._held: dict[int, list[tuple[Header, Payload]]] = {}
        """Messages that arrived while their publisher's history is being fetched."""
        self._asked: set[int] = set()
        self._heard: dict[int, int] = {}
        """The last sequence number of each publisher whose history was delivered."""
        self._looked = False
        """Whether the earlier publishers are known."""
        self._heard_strangers = False

    def lane_to(self, sink: Sink) -> Lane:
        give = self._give_and_acknowledge if self.lossless else self._give
        depth = WAITING if self.lossless else self._depth
        return Lane(self.channel.name, give, depth, lossy=not self.lossless, stats=self.stats)

    def reception(self) -> Reception:
        return Reception(self.channel, self.stats, self._through)

    def open(self) -> None:
        self._hearing = self.transport.topic_service.hear(self)
        self.announce()
        self.look()

    def announce(self, address: str = "") -> None:
        subscription = self._hearing
        super().announce(address or f"{self.id:016x} {subscription.epoch if subscription else 0}")

    def announce_again(self) -> None:
        """Announce a new epoch: messages in transit may be lost, and publishers must not wait for them."""
        with self._closing:
            if self.closed.is_set() or self._entry is None:
                return
            self.transport.member.remove(self._entry)
            self.announce()

    def look(self) -> bool:
        with self._looking:  # an interrupted thread must not overwrite a newer result
            self._look()
        return True

    def _look(self) -> None:
        found = self.counterparts()
        there = {told.id: told for _, entry in found if (told := _publisher(entry.channel, entry.address))}
        self.meet(found)
        with self._taking:
            self._publishers, self._looked = there, True
            for source, unacknowledged in list(self._unacknowledged.items()):
                if source in there:
                    self._acknowledge(there[source], unacknowledged)
                elif len(self._unacknowledged) > _MOST_UNKNOWN:
                    del self._unacknowledged[source]
            jobs = self._catch_up(there) if self._latched else []
        for job in jobs:
            self.transport.do(job)

    def visible(self) -> bool:
        if self._hearing is None or self._hearing.topic.publisher is None:
            return False
        for member, entry in self.counterparts(strict=True):
            told = _publisher(entry.channel, entry.address)
            if told and told.id in self._publishers and self.transport.directory.alive(member.id):
                return True
        return self._heard_strangers

    def release(self) -> None:
        try:
            super().release()
        finally:
            if self._hearing:
                self._hearing.leave(self)

    # On the thread that receives.

    def hear(self, header: Header | None, payload: Payload) -> Job | None:
        """Handle one message; returns the job that remains. Without a header, a foreign publisher sent it."""
        if header is None:
            self._heard_strangers = True
            if self._reception.on:
                payload = self._reception.admit(self.channel.name, 0, payload)
            return self._put(payload if not self.lossless else (None, 0, payload))
        if header.fingerprint != self.channel.type.fingerprint:
            self.meet_stranger(header.source, header.fingerprint)
            return None
        with self._taking:
            if self._latched and not self._is_next(header, payload):
                return None
            return self._admit(header, payload)

    def _admit(self, header: Header, payload: Payload) -> Job | None:
        if not self._ledger.admit(header.source, header.sequence):
            return None
        octets = len(payload)
        if self._reception.on:
            payload = self._reception.admit(header.channel, header.stamp, payload, header.source, header.sequence)
        return self._put((header, octets, payload) if self.lossless else payload)

    def _put(self, item: Any) -> Job | None:
        if not self._lane.put(item):
            self.stats.dropped += 1
            if self.stats.dropped == 1:
                log.warning("%s: %d messages wait; dropping more", self.channel.name, WAITING)
            return None
        return self._lane.drain if self._lane.summon() else None

    # On its way to the sink.

    def _through(self, wrap: Callable[[Sink], Sink]) -> None:
        self._sink = wrap(self._sink)

    def _give(self, payload: Payload) -> None:
        self._sink(payload)

    def _give_and_acknowledge(self, item: tuple[Header | None, int, Payload]) -> None:
        header, octets, payload = item
        if header:
            self._note(header, octets)
        self._sink(payload)

    def _note(self, header: Header, octets: int) -> None:
        """Note a message as taken, and acknowledge if enough have been."""
        source = header.source
        with self._taking:
            publisher, before = self._publishers.get(source), self._unacknowledged.get(source, _NOTHING)
            unacknowledged = _Unacknowledged(before.messages + 1, before.octets + octets, header.sequence)
            self._unacknowledged[source] = unacknowledged
            if publisher:
                self._acknowledge(publisher, unacknowledged)

    def _acknowledge(self, publisher: _PublisherEntry, unacknowledged: _Unacknowledged) -> None:
        if unacknowledged.messages * PARTS >= publisher.ahead or unacknowledged.octets * PARTS >= BYTES_AHEAD:
            del self._unacknowledged[publisher.id]
            self.transport.topic_service.acknowledge(
                publisher.topic_service, publisher.id, self.id, unacknowledged.last
            )

    # Latched messages.

    def _is_next(self, header: Header, payload: Payload) -> bool:
        """Whether a latched message is to be delivered now: after its publisher's history, and only once."""
        source = header.source
        if source not in self._heard:
            if self._looked and source not in self._publishers and source not in self._asked:
                self._heard[source] = header.sequence  # a later publisher, or one outside the directory
                return True
            held = self._held.setdefault(source, [])
            if len(held) < WAITING:
                held.append((header, payload))
            self._ask(source)
            return False
        new = header.sequence > self._heard[source]
        self._heard[source] = max(header.sequence, self._heard[source])
        return new

    def _catch_up(self, there: Mapping[int, _PublisherEntry]) -> list[Job]:
        """Fetch these publishers' histories; deliver the waiting messages of publishers that have left."""
        for source in there:
            self._ask(source)
        self._heard = {each: last for each, last in self._heard.items() if each in there}
        others = [source for source in self._held if source not in there and source not in self._asked]
        return [job for source in others for job in self._admit_all(source, ())]

    def _ask(self, source: int) -> None:
        """Have a publisher's history fetched; its later messages wait until then."""
        publisher = self._publishers.get(source)
        if publisher and source not in self._heard and source not in self._asked:
            self._asked.add(source)
            self.transport.do(partial(self._fetch, publisher))

    def _fetch(self, publisher: _PublisherEntry, tries: int = HISTORY_TRIES) -> None:
        latched = self.transport.topic_service.history(publisher.topic_service, publisher.id)
        if latched is None and publisher.id in self._publishers and not self.closed.is_set():
            if tries > 1:
                self.transport.do(partial(self._fetch, publisher, tries - 1))
                return
            log.warning("%s: the latched messages of its publisher did not come in time", publisher.channel)
        with self._taking:
            jobs = self._admit_all(
                publisher.id, [(Header(*fields, publisher.channel), payload) for fields, payload in latched or ()]
            )
        for job in jobs:
            job()

    def _admit_all(self, source: int, latched: Iterable[tuple[Header, Payload]]) -> list[Job]:
        self._heard[source] = 0
        self._asked.discard(source)
        jobs = [
            self._admit(header, payload)
            for header, payload in (*latched, *self._held.pop(source, ()))
            if header.fingerprint == self.channel.type.fingerprint and self._is_next(header, payload)
        ]
        return [job for job in jobs if job]


class _Unacknowledged(NamedTuple):
    """A publisher's messages taken since the last acknowledgement."""

    messages: int
    octets: int
    last: int
    """The sequence number of the last message."""


_NOTHING = _Unacknowledged(0, 0, 0)


class _PublisherEntry(NamedTuple):
    """A publisher's entry in the directory."""

    id: int
    ahead: int
    topic_service: str
    """A proxy, as text."""
    channel: str


def _publisher(channel: str, address: str) -> _PublisherEntry | None:
    identity, _, rest = address.partition(" ")
    ahead, _, topic_service = rest.partition(" ")
    try:
        return _PublisherEntry(int(identity, 16), int(ahead), topic_service, channel)
    except ValueError:
        return None


def _reader(address: str) -> tuple[int, int] | None:
    """A subscriber's id and epoch."""
    identity, _, epoch = address.partition(" ")
    try:
        return int(identity, 16), int(epoch)
    except ValueError:
        return None
