"""Shared by a transport's publishers and subscribers: subscriptions to IceStorm, and an object for other components.

    context of a publication   rc           our header (`wire.header`), in hexadecimal digits
                               rc-channel   the channel, since an IceStorm topic carries those of all instances

A message without these comes from another program; it goes to all subscribers of the operation.
"""

from __future__ import annotations

import logging
import struct
import threading
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from ...wire.codec import MAX_BYTES, Payload
from ...wire.header import PUBLICATION_BYTES, VERSION, publication_fields
from ...wire.names import ANY, matches
from ..base import Channel, Reply, Status, about_to_block
from ..leader_followers import Job
from . import library
from .messages import NOTHING, RC
from .storm_client import OURS, StormClient, Subscription, Surroundings, Topic

if TYPE_CHECKING:
    from .objects import Invocation

log = logging.getLogger("robocomp.transport.ice")

RC_CHANNEL = "rc-channel"

INQUIRY_MS = 2000
"""Time limit for fetching a publisher's latched messages."""

_MOST_NAMES = 10_000
"""Maximum size of each cache."""

_ENCAPSULATION = struct.Struct("<iBB")
_TOOK, _ASKED, _SIZE = struct.Struct("<QQQ"), struct.Struct("<Q"), struct.Struct("<I")


class Header(NamedTuple):
    """The header of a publication, and its channel."""

    fingerprint: int
    source: int
    sequence: int
    stamp: int
    channel: str


class Publishing(Protocol):
    """A publisher, as subscribers reach it; see `topics.Publisher`."""

    def took(self, reader: int, sequence: int) -> None:
        """That subscriber took the messages up to that number."""

    def history(self) -> list[tuple[bytes, bytes]]:
        """Its latched messages, each with its header."""
        ...


class Hearing(Protocol):
    """A subscriber; see `topics.Subscriber`."""

    channel: Channel
    operation: str

    @property
    def lossless(self) -> bool: ...

    def hear(self, header: Header | None, payload: Payload) -> Job | None:
        """Take a message; returns the job that remains. Foreign publishers send no header."""
        ...

    def announce_again(self) -> None:
        """The subscription was made again, so that messages in transit may be lost."""

    def malformed(self, why: object) -> None: ...


class SharedSubscription:
    """One IceStorm subscription for all links of a transport with the same topic, order and endpoints."""

    def __init__(self, service: TopicService, key: _Key, topic: Topic) -> None:
        self._service, self._key, self.topic = service, key, topic
        self._links: tuple[Hearing, ...] = ()
        self._for: dict[tuple[str, str], tuple[Hearing, ...]] = {}
        """Cache: the links for an operation and channel; the channel is "" for foreign publishers."""
        transport = service.transport
        self._port = transport.port(service.name(OURS), key.endpoints, self._take)
        proxy = transport.communicator.stringToProxy(self._port.proxy)
        self._subscription = Subscription(proxy, key.ordered, renewed=lambda: transport.do(self._renewed))
        service.storm_client.subscribe(topic, self._subscription)

    @property
    def epoch(self) -> int:
        return self._subscription.epoch

    @property
    def idle(self) -> bool:
        return not self._links

    def begin(self) -> None:
        """Wait until IceStorm has made the subscription. Raises TransportError if IceStorm does not answer."""
        self._service.storm_client.subscribed(self._subscription)

    def add(self, link: Hearing) -> None:
        self._links = (*self._links, link)
        self._for = {}

    def leave(self, link: Hearing) -> None:
        self._service.leave(self, self._key, link)

    def remove(self, link: Hearing) -> None:
        self._links = tuple(each for each in self._links if each is not link)
        self._for = {}

    def close(self) -> None:
        self._service.storm_client.unsubscribe(self.topic, self._subscription)
        self._service.storm_client.leave(self.topic)
        self._port.close()

    def _renewed(self) -> None:
        for link in self._links:
            link.announce_again()

    def _take(self, invocation: Invocation) -> Iterable[Job]:
        invocation.reply(_TAKEN)
        try:
            header = _header(invocation.context)
        except ValueError as exc:
            for link in self._links_for(invocation.operation, ""):
                link.malformed(exc)
            return ()
        source = header.source if header else 0
        own = source in self._service.publishers
        jobs = []
        for link in self._links_for(invocation.operation, header.channel if header else ""):
            if not (own and ANY in link.channel.name):
                job = link.hear(header, invocation.payload)
                if job:
                    jobs.append(job)
        return jobs

    def _links_for(self, operation: str, channel: str) -> tuple[Hearing, ...]:
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
    """The header in a context; None for a foreign publisher. Raises ValueError."""
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


class TopicService:
    """A transport's publishers and subscriptions, and the object by which subscribers reach the publishers.

        took      id of the publisher u64 · id of the subscriber u64 · sequence u64       one-way
        history   id of the publisher u64 → (header · size u32 · payload)…

    Both messages are little-endian, each in an encapsulation.
    """

    def __init__(self, transport: Surroundings) -> None:
        self.transport = transport
        self.storm_client = StormClient(transport)
        self.publishers: dict[int, Publishing] = {}
        self._lock = threading.RLock()
        self._subscriptions: dict[_Key, SharedSubscription] = {}
        self._names = 0
        self._port: Any = None
        self._proxies: dict[str, Any] = {}

    def open(self) -> str:
        """Make the object; returns its proxy."""
        with self._lock:
            if self._port is None:
                self._port = self.transport.port(self.name("desk"), "", self._take)
            proxy: str = self._port.proxy
            return proxy

    def hear(self, link: Hearing) -> SharedSubscription:
        """Subscribe a link to its topic. Raises TransportError if IceStorm does not answer."""
        options = self.transport.options
        endpoints = options.subscriber_endpoint_of(link.channel.name) or ""
        # an ordered and an unordered subscription cannot share an endpoint
        key = _Key(options.topic_of(link.channel.name), link.lossless or bool(endpoints), endpoints)
        with self._lock:
            subscription = self._subscriptions.get(key)
            if subscription is None:
                with self.storm_client.using(key.topic) as topic:
                    subscription = self._subscriptions[key] = SharedSubscription(self, key, topic)
            subscription.add(link)
        try:
            subscription.begin()
        except BaseException:
            subscription.leave(link)
            raise
        return subscription

    def leave(self, subscription: SharedSubscription, key: _Key, link: Hearing) -> None:
        with self._lock:
            subscription.remove(link)
            if not subscription.idle or self._subscriptions.get(key) is not subscription:
                return
            del self._subscriptions[key]
        subscription.close()

    def close(self) -> None:
        """Called after all links are closed."""
        self.storm_client.close()
        with self._lock:
            port, self._port = self._port, None
        if port is not None:
            port.close()

    def name(self, category: str) -> str:
        """A new identity for an object."""
        with self._lock:
            self._names += 1
            return f"{category}/{self.storm_client.own_prefix}{self.transport.member.id}-{self._names}"

    def acknowledge(self, address: str, publisher: int, subscriber: int, sequence: int) -> None:
        """Send an acknowledgement to a publisher, without waiting. It is lost if the publisher has left."""
        data = _wrapped(_TOOK.pack(publisher, subscriber, sequence))
        try:
            library.gone(self._proxy(address).ice_oneway().ice_invokeAsync("took", library.NORMAL, data))
        except library.LocalException as exc:
            log.debug("telling %s: %s", address, library.why(exc))

    def history(self, address: str, source: int) -> list[tuple[tuple[int, int, int, int], bytes]] | None:
        """A publisher's latched messages with their headers; none if it has left; None after a timeout."""
        about_to_block()
        try:
            proxy = self._proxy(address).ice_invocationTimeout(INQUIRY_MS)
            ok, answer = proxy.ice_invoke("history", library.NORMAL, _wrapped(_ASKED.pack(source)))
            return list(_unfolded(answer)) if ok else []
        except library.InvocationTimeout:
            return None
        except (library.LocalException, struct.error) as exc:
            log.warning("could not fetch a publisher's latched messages: %s", exc)
            return []

    def _proxy(self, address: str) -> Any:
        proxy = self._proxies.get(address)
        if proxy is None:
            if len(self._proxies) >= _MOST_NAMES:
                self._proxies.clear()
            proxy = self._proxies[address] = self.transport.communicator.stringToProxy(address)
        return proxy

    def _take(self, invocation: Invocation) -> Iterable[Job]:
        data = invocation.payload[_ENCAPSULATION.size :]
        try:
            if invocation.operation == "took":
                source, reader, sequence = _TOOK.unpack(data)
                publisher = self.publishers.get(source)
                if publisher:
                    publisher.took(reader, sequence)
            elif invocation.operation == "history":
                (source,) = _ASKED.unpack(data)
                return [partial(self._send_history, source, invocation)]
            else:
                invocation.not_served()
        except struct.error as exc:
            log.debug("not understood: %s: %s", invocation.operation, exc)
            invocation.not_served()
        return ()

    def _send_history(self, source: int, invocation: Invocation) -> None:
        publisher = self.publishers.get(source)
        room = min(self.transport.limit, MAX_BYTES)
        newest: list[bytes] = []
        for header, payload in reversed(publisher.history() if publisher else []):
            room -= len(header) + _SIZE.size + len(payload)
            if room < 0:
                break
            newest[:0] = (header, _SIZE.pack(len(payload)), payload)
        invocation.reply(Reply(Status.OK, _wrapped(b"".join(newest))))


def _wrapped(data: bytes) -> bytes:
    """The data in an encapsulation."""
    return _ENCAPSULATION.pack(_ENCAPSULATION.size + len(data), 1, 1) + data


def _unfolded(answer: bytes) -> Iterator[tuple[tuple[int, int, int, int], bytes]]:
    """The messages in a reply to `history`. Raises struct.error."""
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
