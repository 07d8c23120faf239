"""Publishers and subscribers, with IceStorm between them.

IceStorm keeps no history and waits for nobody. What is latched is therefore asked of its publisher, and reliable
subscribers tell theirs what they took (`Credit`): both at its `Desk`, of which the directory tells. Those of other
hosts are out of its reach; to them, reliable is what IceStorm makes of it: acknowledged by it, delivered one by one.
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
from ...wire import names
from ...wire.codec import Payload
from ...wire.header import pack_publication, random_id
from ..base import Channel, Sink, depth_of
from ..credit import Credit
from ..directory_transport import DirectoryLink
from ..leader_followers import Job, Lane
from ..limits import BYTES_AHEAD, MOST_AHEAD, PARTS, STRANGERS
from ..reception import HISTORY_TRIES, Reception
from ..topics import SubscribingLink
from . import library
from .desk import RC_CHANNEL, Header, Hearing
from .exchange import Topic
from .messages import RC

if TYPE_CHECKING:
    from .transport import IceTransport

log = logging.getLogger("robocomp.transport.ice")

WAITING = 10_000
"""Messages that may wait at a reliable subscriber; only publishers that do not wait for it can send as many."""

_FEWEST_UNSENT = 8
"""So many messages may be on their way to IceStorm, however few its publisher keeps."""

_MOST_UNSENT_BYTES = 64 * 1024 * 1024
"""While so many are, nothing more is sent; the last message may be of any size."""

_MOST_UNKNOWN = 1000
"""Of so many publishers that the directory does not tell of it is remembered what was taken."""

_READERS = 0.02
"""Seconds for which it is taken for known who reads what we publish."""


class Publisher(DirectoryLink["IceTransport"]):
    role, facing = "publishes", "subscribes"
    _topic: Topic | None = None

    def __init__(self, transport: IceTransport, channel: Channel) -> None:
        super().__init__(transport, channel)
        qos = channel.qos
        self.id = random_id()
        self._lossless = qos.reliable
        self._operation = names.operation(channel.name)
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
        exchange = self.transport.desk.exchange
        with exchange.using(self.transport.options.topic_of(self.channel.name)) as topic:
            exchange.reach(topic)
        self._topic = topic
        desk = self.transport.desk.open()
        self.transport.desk.publishers[self.id] = self
        self.announce(f"{self.id:016x} {self.ahead} {desk}")

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
                self._history.append((header, data))  # first: who asks for it now may not hear the other one
            context = {RC: header.hex(), RC_CHANNEL: self.channel.name}
            if self._lossless:
                self._pass_on(data, context, end, deadline)
            else:
                self._throw(data, context)
        finally:
            self._order.release()

    def visible(self) -> bool:
        topic = self._topic
        if topic is None or topic.publisher is None:
            return False
        if any(self.transport.directory.alive(member.id) for member, _ in self.counterparts(strict=True)):
            return True
        self.transport.desk.exchange.look_soon()
        return topic.strangers

    def release(self) -> None:
        self.transport.desk.publishers.pop(self.id, None)
        if self._topic:
            self.transport.desk.exchange.leave(self._topic)

    # By the desk.

    def took(self, reader: int, sequence: int) -> None:
        self._credit.took(reader, sequence)

    def history(self) -> list[tuple[bytes, bytes]]:
        return list(self._history)

    # Sending.

    def _throw(self, data: bytes, context: Mapping[str, str]) -> None:
        """To whoever is there, if that goes without waiting."""
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

    def _pass_on(self, data: bytes, context: Mapping[str, str], end: float, deadline: float) -> None:
        """Have IceStorm acknowledge it. It is not sent again if it may have arrived."""
        assert self._topic
        while True:
            proxy = self._await_storm(end, deadline)
            future = self._invoke(proxy, data, context)
            try:
                future.result(max(0.001, end - time.monotonic()))
                return
            except library.NotServed:  # another IceStorm, which does not know of the topic yet
                self.transport.desk.exchange.lost()
                self._topic.publisher = None
            except library.Late as exc:
                future.cancel()
                raise Timeout(f"{self.channel.name}: IceStorm did not take it for {deadline:g} s") from exc
            except library.LocalException as exc:
                self.transport.desk.exchange.lost()
                raise self._failed(exc) from exc

    def _await_storm(self, end: float, deadline: float) -> Any:
        assert self._topic
        while (proxy := self._topic.publisher) is None:
            self.check_open()
            if time.monotonic() >= end:
                raise Timeout(f"{self.channel.name}: for {deadline:g} s, {self.transport.desk.exchange.absent()}")
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
        """Those who tell what they took, and since when: another number, once what was on its way may be lost."""
        epoch = self._topic.epoch if self._topic else 0
        for member, entry in self.counterparts():
            told = _reader(entry.address)
            if told and from_traits(entry.traits).reliable and self.transport.directory.alive(member.id):
                yield told[0], epoch << 32 | told[1]


class Subscriber(SubscribingLink["IceTransport"]):
    _hearing: Hearing | None = None

    def __init__(self, transport: IceTransport, channel: Channel, sink: Sink) -> None:
        self._sink = sink
        super().__init__(transport, channel, sink)
        self.id = random_id()
        self.operation = names.operation(channel.name)
        self._latched = channel.qos.latched
        self._taking = threading.RLock()
        self._publishers: dict[int, _Told] = {}
        """By their ids."""
        self._untold: dict[int, _Untold] = {}
        """By publisher."""
        self._held: dict[int, list[tuple[Header, Payload]]] = {}
        """Of publishers that are asked for what they latched: what else they sent meanwhile."""
        self._asked: set[int] = set()
        self._heard: dict[int, int] = {}
        """The last numbers of publishers of which nothing is missed that they latched."""
        self._looked = False
        """Whether those who published before we subscribed are known."""
        self._met: set[int] = set()
        """Publishers that mean something else."""
        self._heard_strangers = False

    def lane_to(self, sink: Sink) -> Lane:
        give = self._give_and_tell if self.lossless else self._give
        depth = WAITING if self.lossless else self._depth
        return Lane(self.channel.name, give, depth, lossy=not self.lossless, stats=self.stats)

    def reception(self) -> Reception:
        return Reception(self.channel, self.stats, self._through)

    def open(self) -> None:
        self._hearing = self.transport.desk.hear(self)
        self.announce()
        self.look()

    def announce(self, address: str = "") -> None:
        hearing = self._hearing
        super().announce(address or f"{self.id:016x} {hearing.epoch if hearing else 0}")

    def announce_again(self) -> None:
        """What was on its way to us may be lost: publishers that wait for us must not wait for that."""
        with self._closing:
            if self.closed.is_set() or self._entry is None:
                return
            self.transport.member.remove(self._entry)
            self.announce()

    def look(self) -> bool:
        found = self.counterparts()
        there = {told.id: told for _, entry in found if (told := _publisher(entry.channel, entry.address))}
        self.meet(found)
        with self._taking:
            self._publishers, self._looked = there, True
            for source, untold in list(self._untold.items()):
                if source in there:
                    self._tell(there[source], untold)
                elif len(self._untold) > _MOST_UNKNOWN:
                    del self._untold[source]
            jobs = self._catch_up(there) if self._latched else []
        for job in jobs:
            self.transport.do(job)
        return True

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
        """One message; what is left to be done about it. Without a header it is a stranger's."""
        if header is None:
            self._heard_strangers = True
            if self._reception.on:
                payload = self._reception.admit(self.channel.name, 0, payload)
            return self._put(payload if not self.lossless else (None, 0, payload))
        if header.fingerprint != self.channel.type.fingerprint:
            self._meet(header)
            return None
        with self._taking:
            if self._latched and not self._is_next(header, payload):
                return None
            return self._admit(header, payload)

    def _meet(self, header: Header) -> None:
        """Report, once, who means something else: with its words, where the directory has them."""
        if header.source in self._met or len(self._met) >= STRANGERS:
            return
        self._met.add(header.source)
        self.counterparts()
        entries = self.transport.directory.find(self.facing, self.channel.name)
        if not any(entry.fingerprint == header.fingerprint for _, entry in entries):
            self.report_mismatch(header.source, header.fingerprint)

    def _admit(self, header: Header, payload: Payload) -> Job | None:
        if not self._ledger.admit(header.source, header.sequence):
            return None
        octets = len(payload)
        if self._reception.on:
            payload = self._reception.admit(header.channel, header.stamp, payload)
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

    def _give_and_tell(self, item: tuple[Header | None, int, Payload]) -> None:
        header, octets, payload = item
        if header:
            self._note(header, octets)
        self._sink(payload)

    def _note(self, header: Header, octets: int) -> None:
        """Have it told to its publisher that a message was taken, when it is worth telling."""
        source = header.source
        with self._taking:
            publisher, before = self._publishers.get(source), self._untold.get(source, _NOTHING)
            untold = _Untold(before.messages + 1, before.octets + octets, header.sequence)
            self._untold[source] = untold
            if publisher:
                self._tell(publisher, untold)

    def _tell(self, publisher: _Told, untold: _Untold) -> None:
        if untold.messages * PARTS >= publisher.ahead or untold.octets * PARTS >= BYTES_AHEAD:
            del self._untold[publisher.id]
            self.transport.desk.tell_taken(publisher.desk, publisher.id, self.id, untold.last)

    # What is latched.

    def _is_next(self, header: Header, payload: Payload) -> bool:
        """Whether all that precedes a latched message was heard, and itself was not."""
        source = header.source
        if source not in self._heard:
            if self._looked and source not in self._publishers and source not in self._asked:
                self._heard[source] = header.sequence  # it came after us, or the directory does not tell of it
                return True
            held = self._held.setdefault(source, [])
            if len(held) < WAITING:
                held.append((header, payload))
            self._ask(source)
            return False
        new = header.sequence > self._heard[source]
        self._heard[source] = max(header.sequence, self._heard[source])
        return new

    def _catch_up(self, there: Mapping[int, _Told]) -> list[Job]:
        """Have fetched what these latched. What others sent in the meantime is not to wait any longer."""
        for source in there:
            self._ask(source)
        self._heard = {each: last for each, last in self._heard.items() if each in there}
        others = [source for source in self._held if source not in there and source not in self._asked]
        return [job for source in others for job in self._admit_all(source, ())]

    def _ask(self, source: int) -> None:
        """Have a publisher's history fetched; what else comes from it has to wait until it is there."""
        publisher = self._publishers.get(source)
        if publisher and source not in self._heard and source not in self._asked:
            self._asked.add(source)
            self.transport.do(partial(self._fetch, publisher))

    def _fetch(self, publisher: _Told, tries: int = HISTORY_TRIES) -> None:
        latched = self.transport.desk.history(publisher.desk, publisher.id)
        if latched is None and publisher.id in self._publishers and not self.closed.is_set():
            if tries > 1:
                self.transport.do(partial(self._fetch, publisher, tries - 1))
                return
            log.warning("%s: what its publisher has latched did not come in time", publisher.channel)
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


class _Untold(NamedTuple):
    """What was taken of a publisher since it was told so."""

    messages: int
    octets: int
    last: int
    """The number of the last message."""


_NOTHING = _Untold(0, 0, 0)


class _Told(NamedTuple):
    """What the directory tells of a publisher."""

    id: int
    ahead: int
    desk: str
    """A proxy, in words."""
    channel: str


def _publisher(channel: str, address: str) -> _Told | None:
    identity, _, rest = address.partition(" ")
    ahead, _, desk = rest.partition(" ")
    try:
        return _Told(int(identity, 16), int(ahead), desk, channel)
    except ValueError:
        return None


def _reader(address: str) -> tuple[int, int] | None:
    """A subscriber's id, and how often it has subscribed."""
    identity, _, epoch = address.partition(" ")
    try:
        return int(identity, 16), int(epoch)
    except ValueError:
        return None
