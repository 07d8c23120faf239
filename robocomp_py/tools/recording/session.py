"""Records the topics of a running network, also those that appear later."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from ...contract.interface import Pattern
from ...errors import HostUnreachable, RobocompError
from ...transports.base import Heard as Headed
from ...wire.codec import Payload
from ..access import Access, Subscription
from ..far import FarLink
from ..network import Channel, Network, NotUnderstood
from .layout import Topic
from .writer import Convert, to_cdr

DEPTH = 100
"""Messages of a topic that may wait inside of a middleware."""

_LOOK = 1.0
"""Seconds between two looks for topics that are new. A look takes at most half of the time, and a tenth of the
processor's."""

_EAGER = 10.0
"""Seconds after the first look in which a look may take longer, if there is no topic yet. A command waits for one. Its
first look may come too early, and takes long, since it imports what a middleware needs."""


class Track(Protocol):
    """Takes the messages of a topic, on any thread, and counts them."""

    received: int
    dropped: int
    malformed: int
    written: int

    def put(self, payload: Payload, stamp: int = 0, sequence: int = 0) -> None: ...


class Tracks(Protocol):
    """What topics are recorded by, or shown by."""

    def track(self, topic: Topic, convert: Convert) -> Track: ...


@dataclass
class Followed:
    """A topic that is being recorded."""

    channel: Channel
    track: Track
    link: Subscription

    @property
    def host(self) -> str:
        """The name of another host that it comes from, or ""."""
        return host_of(self.link)

    @property
    def lost(self) -> int:
        """Messages that publishers sent and that did not arrive here, as far as their numbers tell."""
        stats = self.link.stats
        return stats.lost + stats.dropped

    @property
    def unreadable(self) -> int:
        return self.link.stats.malformed + self.link.stats.mismatched + self.track.malformed


class Session:
    """What is recorded now. `look` is to be called again and again."""

    def __init__(
        self,
        recorder: Tracks,
        access: Access,
        census: Callable[[], Network],
        wanted: Sequence[str],
        tell: Callable[[str], object],
        also: Callable[[Network], object] = lambda network: None,
    ) -> None:
        """`wanted` are names as commands take them; none are all topics. `tell` gets messages for people, and `also`
        each look at the network."""
        self._recorder, self._access, self._census, self._wanted, self._tell = recorder, access, census, wanted, tell
        self._also = also
        self._followed: dict[tuple[str, str, str, int], Followed] = {}
        """By topic, host, middleware and contract."""
        self._failed: set[tuple[str, str]] = set()
        self._next = 0.0
        self._begun = 0.0
        """When the first look began."""

    @property
    def followed(self) -> list[Followed]:
        return list(self._followed.values())

    def look(self) -> None:
        """Subscribe to what is new, if it is time to look. Raises TransportError if no middleware can tell."""
        begun = time.monotonic()
        if begun < self._next:
            return
        used = time.thread_time()
        self._begun = self._begun or begun
        network = self._census()
        ended = time.monotonic()
        self._next = max(begun + _LOOK, 2 * ended - begun, begun + 10 * (time.thread_time() - used))
        for channel in chosen(network, self._wanted):
            self._follow(channel)
        if self._followed:  # otherwise the caller tells what it waits for
            self._propose(network)
        elif ended - self._begun < _EAGER:
            self._next = begun + _LOOK
        self._also(network)

    def _propose(self, network: Network) -> None:
        """Tell once of each name that is not published but resembles one that is."""
        for name in self._wanted:
            if chosen(network, (name,)):
                continue
            if why := network.no_topic(name):
                self._complain(name, f"{why}; --calls records its calls")
            elif near := network.closest(name, Pattern.PUBLISH):
                self._complain(name, f"nothing publishes `{name}` so far; did you mean `{near}`?")

    def _follow(self, channel: Channel) -> None:
        known: list[Followed] = []

        def is_followed(each: Channel) -> bool:
            found = self._followed.get(_key(each))
            known.extend([found] if found else [])
            return found is not None

        try:
            new = channel.each_way(is_followed)
        except NotUnderstood as exc:
            self._complain(channel.name, str(exc))
            return
        for followed in known:
            with self._complaining(channel):
                listen_again(followed.link)
        for each in new:
            with self._complaining(channel):
                self._followed[_key(each)] = self._opened(each)
                self._tell(f"{channel.name} {way_of(each)}")

    @contextlib.contextmanager
    def _complaining(self, channel: Channel) -> Iterator[None]:
        """Tell of an error, once."""
        try:
            yield
        except RobocompError as exc:
            self._complain(channel.name, f"{channel.name}: {exc}")

    def _opened(self, channel: Channel) -> Followed:
        middleware = channel.middlewares[0]
        publishers = ",".join(dict.fromkeys(each.told.owner for each in channel.providers if each.told.owner))
        topic = Topic(channel.name, channel.operation, publishers, middleware, channel.qos, host=channel.host)
        codec = self._access.codec(channel)
        track = self._recorder.track(topic, to_cdr(codec, channel.operation.request))

        def put(heard: Headed) -> None:
            track.put(heard.payload, heard.stamp, heard.sequence)

        return Followed(channel, track, self._access.hear(channel, put, DEPTH, headed=True).link)

    def _complain(self, name: str, text: str) -> None:
        if (name, text) not in self._failed:
            self._failed.add((name, text))
            self._tell(text)


def host_of(link: Subscription | None) -> str:
    """The name of another host that a subscription hears, or ""."""
    return link.host if isinstance(link, FarLink) else ""


def listen_again(link: Subscription | None) -> None:
    """On a host that was lost, and is there again. Raises RobocompError if it can not be heard for another reason."""
    if isinstance(link, FarLink) and (error := link.error):
        link.open()
        if not isinstance(error, HostUnreachable):
            raise error


def way_of(channel: Channel) -> str:
    """How a channel is heard, for people."""
    return f"over {channel.middlewares[0]}{f' of {channel.host}' if channel.via else ''}"


def _key(channel: Channel) -> tuple[str, str, str, int]:
    """Of a subscription. Raises NotUnderstood."""
    return channel.name, channel.host, channel.middlewares[0], channel.operation.fingerprint


def chosen(network: Network, wanted: Sequence[str]) -> list[Channel]:
    """The topics among these that something publishes; without names, all of them."""
    found: dict[str, Any] = {}
    if not wanted:
        found = dict(network.channels)
    for name in wanted:
        try:
            found |= {each.name: each for each in network.named(name)}
        except ValueError:
            continue  # it may appear later
    return [each for each in found.values() if each.pattern is Pattern.PUBLISH and each.providers]
