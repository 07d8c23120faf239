"""What the publishers and subscribers of a transport share: what IceStorm sends them, and the object that others ask.

    context of a publication   rc           our header (`wire.header`), in hexadecimal digits
                               rc-channel   the channel, as a topic of IceStorm's carries those of all instances

What comes without these is somebody else's, and for all who subscribe to such an operation.
"""

from __future__ import annotations

import logging
import struct
import threading
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from ...wire.codec import MAX_BYTES
from ...wire.header import PUBLICATION_BYTES, VERSION, publication_fields
from ...wire.names import ANY, matches
from ..base import Reply, Status, about_to_block
from ..leader_followers import Job
from . import library
from .exchange import OURS, Exchange, Subscription, Topic
from .messages import NOTHING, RC

if TYPE_CHECKING:
    from .objects import Arrived
    from .topics import Publisher, Subscriber
    from .transport import IceTransport

log = logging.getLogger("robocomp.transport.ice")

RC_CHANNEL = "rc-channel"

INQUIRY_MS = 2000
"""For so long a publisher is asked for what it has latched."""

_MOST_NAMES = 10_000
"""Of so many channels it is remembered who hears them."""

_ENCAPSULATION = struct.Struct("<iBB")
_TOOK, _ASKED, _SIZE = struct.Struct("<QQQ"), struct.Struct("<Q"), struct.Struct("<I")


class Header(NamedTuple):
    """What a publication of ours comes with."""

    fingerprint: int
    source: int
    sequence: int
    stamp: int
    channel: str


class Hearing:
    """One subscription, for all links of a transport that hear the same topic in the same way."""

    def __init__(self, desk: Desk, key: _Key, topic: Topic) -> None:
        self._desk, self._key, self.topic = desk, key, topic
        self._links: tuple[Subscriber, ...] = ()
        self._for: dict[tuple[str, str], tuple[Subscriber, ...]] = {}
        """By operation and channel; that of strangers is ""."""
        transport = desk.transport
        self._port = transport.port(desk.name(OURS), key.endpoints, self._take)
        proxy = transport.communicator.stringToProxy(self._port.proxy)
        self._subscription = Subscription(proxy, key.ordered, renewed=lambda: transport.do(self._renewed))
        desk.exchange.subscribe(topic, self._subscription)

    @property
    def epoch(self) -> int:
        return self._subscription.epoch

    @property
    def idle(self) -> bool:
        return not self._links

    def begin(self) -> None:
        """Wait until it is made. Raises TransportError if IceStorm is not there."""
        self._desk.exchange.subscribed(self._subscription)

    def add(self, link: Subscriber) -> None:
        self._links = (*self._links, link)
        self._for = {}

    def leave(self, link: Subscriber) -> None:
        self._desk.leave(self, self._key, link)

    def remove(self, link: Subscriber) -> None:
        self._links = tuple(each for each in self._links if each is not link)
        self._for = {}

    def close(self) -> None:
        self._desk.exchange.unsubscribe(self.topic, self._subscription)
        self._desk.exchange.leave(self.topic)
        self._port.close()

    def _renewed(self) -> None:
        for link in self._links:
            link.announce_again()

    def _take(self, arrived: Arrived) -> Iterable[Job]:
        arrived.reply(_TAKEN)
        try:
            header = _header(arrived.context)
        except ValueError as exc:
            for link in self._hearing(arrived.operation, ""):
                link.malformed(exc)
            return ()
        source = header.source if header else 0
        own = source in self._desk.publishers
        jobs = []
        for link in self._hearing(arrived.operation, header.channel if header else ""):
            if not (own and ANY in link.channel.name):
                job = link.hear(header, arrived.payload)
                if job:
                    jobs.append(job)
        return jobs

    def _hearing(self, operation: str, channel: str) -> tuple[Subscriber, ...]:
        known = self._for.get((operation, channel))
        if known is None:
            if len(self._for) >= _MOST_NAMES:
                self._for = {}
            known = self._for[operation, channel] = tuple(
                link
                for link in self._links
                if link.operation == operation and (not channel or matches(link.channel.name, channel))
            )
        return known


_TAKEN = Reply(Status.OK, NOTHING)


def _header(context: Mapping[str, str]) -> Header | None:
    """None if somebody else publishes, who may use the key for something else. Raises ValueError."""
    told, channel = context.get(RC), context.get(RC_CHANNEL)
    if told is None or channel is None:
        return None
    try:
        version, fingerprint, source, sequence, stamp = publication_fields(bytes.fromhex(told))
    except struct.error as exc:
        raise ValueError(f"its header: {exc}") from exc
    if version != VERSION:
        raise ValueError(f"its header has version {version}")
    return Header(fingerprint, source, sequence, stamp, channel)


class _Key(NamedTuple):
    topic: str
    ordered: bool
    endpoints: str


class Desk:
    """Of a transport: who publishes and who subscribes there, and the object at which others ask and tell publishers.

        took      id of the publisher u64 · id of the subscriber u64 · sequence u64       one-way
        history   id of the publisher u64 → (header · size u32 · payload)…

    Little-endian, in an encapsulation each.
    """

    def __init__(self, transport: IceTransport) -> None:
        self.transport = transport
        self.exchange = Exchange(transport)
        self.publishers: dict[int, Publisher] = {}
        self._lock = threading.RLock()
        self._hearings: dict[_Key, Hearing] = {}
        self._names = 0
        self._port: Any = None
        self._proxies: dict[str, Any] = {}

    def open(self) -> str:
        """Where it is reached."""
        with self._lock:
            if self._port is None:
                self._port = self.transport.port(self.name("desk"), "", self._take)
            proxy: str = self._port.proxy
            return proxy

    def hear(self, link: Subscriber) -> Hearing:
        """Have a link hear its topic. Raises TransportError if IceStorm is not there."""
        options = self.transport.options
        endpoints = options.subscriber_endpoint_of(link.channel.name) or ""
        # two ways to hear cannot share a port
        key = _Key(options.topic_of(link.channel.name), link.lossless or bool(endpoints), endpoints)
        with self._lock:
            hearing = self._hearings.get(key)
            if hearing is None:
                with self.exchange.using(key.topic) as topic:
                    hearing = self._hearings[key] = Hearing(self, key, topic)
            hearing.add(link)
        try:
            hearing.begin()
        except BaseException:
            hearing.leave(link)
            raise
        return hearing

    def leave(self, hearing: Hearing, key: _Key, link: Subscriber) -> None:
        with self._lock:
            hearing.remove(link)
            if not hearing.idle or self._hearings.get(key) is not hearing:
                return
            del self._hearings[key]
        hearing.close()

    def close(self) -> None:
        """All links are closed."""
        self.exchange.close()
        with self._lock:
            port, self._port = self._port, None
        if port is not None:
            port.close()

    def name(self, category: str) -> str:
        """An identity of an object of ours, not used yet."""
        with self._lock:
            self._names += 1
            return f"{category}/{self.exchange.neighbours}{self.transport.member.id}-{self._names}"

    def tell_taken(self, desk: str, publisher: int, subscriber: int, sequence: int) -> None:
        """Tell a publisher what a subscriber took, without waiting. One that has left is not told."""
        data = _wrapped(_TOOK.pack(publisher, subscriber, sequence))
        try:
            library.gone(self._proxy(desk).ice_oneway().ice_invokeAsync("took", library.NORMAL, data))
        except library.LocalException as exc:
            log.debug("telling %s: %s", desk, library.why(exc))

    def history(self, desk: str, source: int) -> list[tuple[tuple[int, int, int, int], bytes]] | None:
        """What a publisher has latched: headers, and payloads; nothing, if it has gone; None, if that took too long."""
        about_to_block()
        try:
            proxy = self._proxy(desk).ice_invocationTimeout(INQUIRY_MS)
            ok, answer = proxy.ice_invoke("history", library.NORMAL, _wrapped(_ASKED.pack(source)))
            return list(_unfolded(answer)) if ok else []
        except library.InvocationTimeout:
            return None
        except (library.LocalException, struct.error) as exc:
            log.warning("what a publisher has latched could not be fetched: %s", exc)
            return []

    def _proxy(self, desk: str) -> Any:
        proxy = self._proxies.get(desk)
        if proxy is None:
            if len(self._proxies) >= _MOST_NAMES:
                self._proxies.clear()
            proxy = self._proxies[desk] = self.transport.communicator.stringToProxy(desk)
        return proxy

    def _take(self, arrived: Arrived) -> Iterable[Job]:
        data = arrived.payload[_ENCAPSULATION.size :]
        try:
            if arrived.operation == "took":
                source, reader, sequence = _TOOK.unpack(data)
                publisher = self.publishers.get(source)
                if publisher:
                    publisher.took(reader, sequence)
            elif arrived.operation == "history":
                (source,) = _ASKED.unpack(data)
                return [partial(self._tell_history, source, arrived)]
            else:
                arrived.not_served()
        except struct.error as exc:
            log.debug("not understood: %s: %s", arrived.operation, exc)
            arrived.not_served()
        return ()

    def _tell_history(self, source: int, arrived: Arrived) -> None:
        publisher = self.publishers.get(source)
        room = min(self.transport.limit, MAX_BYTES)
        newest: list[bytes] = []
        for header, payload in reversed(publisher.history() if publisher else []):
            room -= len(header) + _SIZE.size + len(payload)
            if room < 0:
                break
            newest[:0] = (header, _SIZE.pack(len(payload)), payload)
        arrived.reply(Reply(Status.OK, _wrapped(b"".join(newest))))


def _wrapped(data: bytes) -> bytes:
    """An encapsulation."""
    return _ENCAPSULATION.pack(_ENCAPSULATION.size + len(data), 1, 1) + data


def _unfolded(answer: bytes) -> Iterator[tuple[tuple[int, int, int, int], bytes]]:
    """Raises struct.error."""
    at = _ENCAPSULATION.size
    while at < len(answer):
        _, *fields = publication_fields(answer[at : at + PUBLICATION_BYTES])
        at += PUBLICATION_BYTES
        (size,) = _SIZE.unpack_from(answer, at)
        at += _SIZE.size
        if at + size > len(answer):
            raise struct.error("it ends in the middle of a message")
        fingerprint, source, sequence, stamp = fields
        yield (fingerprint, source, sequence, stamp), answer[at : at + size]
        at += size
