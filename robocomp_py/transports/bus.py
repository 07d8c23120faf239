"""Links of one process, which know each other as objects: all links of the transports that share a bus."""

from __future__ import annotations

import threading
from typing import Any, NamedTuple, TypeVar

from ..errors import AlreadyServed
from ..wire.names import matches
from .base import Channel
from .link import BaseLink, BaseTransport


class Bus:
    """Its lock is never held while calling out."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.version = 0
        """Grows with every link that comes or goes."""
        self.links: list[BusLink[Any]] = []


class OnBus(NamedTuple):
    """A link, as its peers see it."""

    link: Any
    channel: str
    fingerprint: int
    text: str

    @property
    def key(self) -> int:
        return id(self.link)


class BusTransport(BaseTransport[OnBus]):
    group = ""
    """Links of different groups do not meet."""

    def __init__(self, bus: Bus) -> None:
        super().__init__()
        self.bus = bus

    def find(self, role: str, channel: str) -> list[OnBus]:
        with self.bus.lock:
            there = [link.seen for link in self.bus.links if link.role == role]
        return [each for each in there if matches(each.channel, channel) or matches(channel, each.channel)]

    def is_own(self, peer: OnBus) -> bool:
        return peer.link.transport is self


T = TypeVar("T", bound=BusTransport)


class BusLink(BaseLink[T, OnBus]):
    sides: tuple[str, str]
    """This end and the other one. Links of different patterns do not meet."""
    alone = False
    """Whether a channel may have only one such link."""

    def __init__(self, transport: T, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.role, self.facing = (f"{transport.group}{channel.pattern} {side}" for side in self.sides)
        self.seen = OnBus(self, channel.name, channel.type.fingerprint, channel.type.text)
        self.bus = transport.bus
        self._looked: tuple[int, list[Any]] = -1, []
        """A version of the bus, and the peers that it had."""

    def peers(self) -> list[Any]:
        """The links of the other side with the same contract."""
        version = self.bus.version  # before the look, so that a later change causes another one
        if self._looked[0] != version:
            self._looked = version, [peer.link for peer in self.counterparts()]
        return self._looked[1]

    def open(self) -> None:
        with self.bus.lock:
            if self.alone and self.matching(self.role):
                raise AlreadyServed(f"{self.channel.name}: already served")
            self.bus.links.append(self)
            self.bus.version += 1
        for link in (self, *(peer.link for peer in self.faced())):
            link.look()
            link.has_news()

    def withdraw(self) -> None:
        with self.bus.lock:
            if self in self.bus.links:
                self.bus.links.remove(self)
            self.bus.version += 1
