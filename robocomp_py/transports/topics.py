"""Publishers and subscribers of transports whose links find each other in the directory."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable

from ..contract.qos import from_traits
from ..wire.codec import Payload
from ..wire.header import Publication, pack_publication, random_id
from .base import Channel, Sink, Source, SupportsSources, depth_of
from .directory_transport import DirectoryLink, T
from .leader_followers import Job, Lane
from .ledger import Ledger
from .members import Found
from .reception import Reception, living

Fields = tuple[int, int, int, int, int]
"""The fields of a `Publication`."""


class PublishingLink(DirectoryLink[T], ABC):
    """Numbers its messages, and sends one at a time."""

    role, facing = "publishes", "subscribes"

    def __init__(self, transport: T, channel: Channel) -> None:
        super().__init__(transport, channel)
        self.id, self._sent, self._order = random_id(), 0, threading.Lock()

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        end = time.monotonic() + deadline
        self.take_turn(self._order, deadline)
        try:
            self.check_open()
            self._sent += 1
            header = pack_publication(self.channel.type.fingerprint, self.id, self._sent, time.time_ns())
            self.publish(header, payload, end)
        finally:
            self._order.release()

    @abstractmethod
    def publish(self, header: bytes, payload: Payload, end: float) -> None:
        """Send a message to all subscribers (`counterparts`); a reliable one waits until `end` for slow ones."""


class SubscribingLink(DirectoryLink[T], SupportsSources):
    """Counts lost and repeated messages, applies the QoS, and gives the sink one message at a time."""

    role, facing = "subscribes", "publishes"

    def __init__(self, transport: T, channel: Channel, sink: Sink) -> None:
        super().__init__(transport, channel)
        self.lossless, self._depth = channel.qos.reliable, depth_of(channel.qos)
        self._fingerprint = channel.type.fingerprint
        self._lane = self.lane_to(sink)
        self._reception = self.reception()
        self._ledger = Ledger(self.stats, ordered=True)

    def lane_to(self, sink: Sink) -> Lane:
        return Lane(self.channel.name, sink, self._depth, lossy=not self.lossless, stats=self.stats)

    def reception(self) -> Reception:
        return Reception(self.channel, self.stats, self._lane.through)

    def look(self) -> bool:
        self.meet(self.counterparts())
        return True

    def meet(self, found: Iterable[Found]) -> None:
        """Set the present publishers."""
        self._reception.meet(_source(each) for each in found)

    def sources(self) -> list[Source]:
        return living(self.transport.directory, self.counterparts(), self.channel.qos)

    def take(self, channel: str, header: Publication, payload: Payload) -> Job | None:
        """Take a message that arrived; returns the job that remains.

        `channel` is that of its publisher, which may differ from this one by `*`.
        """
        if not self._ledger.knows(header.source):  # a publisher newer than the last look may offer a lifespan
            self.meet(self.counterparts())
        admitted = self.admitted(channel, header, payload)
        return self._lane.drain if admitted is not None and self._lane.put(admitted) else None

    def admitted(self, channel: str, header: Fields, payload: Payload) -> Payload | None:
        """What to put into the lane for a message; None if its contract differs or it was received before."""
        _, fingerprint, source, sequence, stamp = header
        if fingerprint != self._fingerprint:
            self.meet_stranger(source, fingerprint)
            return None
        if not self._ledger.admit(source, sequence):
            return None
        if not self._reception.on:
            return payload
        return self._reception.admit(channel, stamp, payload, source, sequence)

    def release(self) -> None:
        self._lane.close()


def _source(found: Found) -> Source:
    return Source(found.entry.channel, from_traits(found.entry.traits))
