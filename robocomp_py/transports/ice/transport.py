"""The transport: its links, its communicator, its thread."""

from __future__ import annotations

import contextlib
import itertools
import logging
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, TypeVar

from ...contract.interface import Pattern
from ...errors import Closed
from ...wire.codec import MAX_BYTES, Codec
from ...wire.ice import Ice
from .. import iceoptions
from ..announced import AnnouncedLink, Announcing
from ..base import ANY_QOS, Capability, Channel, Service, Sink, TransportConfig
from ..crew import Crew, Job, abandoned
from ..directory import Directory, runtime_dir
from ..memory import keep_memory
from ..served import ServingLink
from .asking import Caller, CommandOutlet, Peer
from .desk import Desk
from .library import communicator
from .objects import Intake, Port, Take
from .serving import CommandInlet, Offer, Server
from .storm import hosted
from .topics import Publisher, Subscriber

log = logging.getLogger("robocomp.transport.ice")

TICK = 0.25
"""Seconds between two looks at what should be as it was."""

ROLL_CALL = 1.0
"""Seconds between two looks whether those we deal with still live, of which the directory need not tell."""

L = TypeVar("L", bound=AnnouncedLink[Any])


class IceTransport(Announcing):
    """Options: see `iceoptions`. A message that is larger than `message_size_max` is not taken, and not sent."""

    capabilities = ANY_QOS | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        super().__init__()
        self.options = iceoptions.read(config.options)
        self.limit = self.options.message_size_max or MAX_BYTES
        """Octets of a whole message."""
        if self.options.endpoints or self.options.proxies or self.options.host != iceoptions.HOST:
            self.capabilities |= Capability.CROSS_HOST
        self.codec: Codec = Ice()
        self.owner, self.wanted = config.owner, config.wanted
        self.folder = runtime_dir() / "ice"
        self.served = self.folder / "served"
        self.directory = Directory(self.folder)
        self._numbers = itertools.count(1)
        self._offers: dict[str, Offer] = {}
        self._peers: dict[tuple[str, str], Peer] = {}
        self._intake = Intake()
        self._next_tick = self._call_at = 0.0
        self._crew: Crew | None = None
        keep_memory()
        self.communicator = communicator(self.options, self.limit, self._tell)
        try:
            self.member = self.directory.join(config.owner)
        except BaseException:
            self.communicator.destroy()
            raise
        self.desk = Desk(self)
        self._crew = Crew("ice", self._receive, wake=self.look_soon)
        self._crew.start()

    @staticmethod
    def host(config: TransportConfig) -> contextlib.AbstractContextManager[None]:
        """See `base.hosting`: run IceStorm, unless somebody does, or it is elsewhere."""
        return hosted(iceoptions.read(config.options), config.owner)

    def outlet(self, channel: Channel) -> Publisher | CommandOutlet:
        kind = Publisher if channel.pattern is Pattern.PUBLISH else CommandOutlet
        return self._open(kind(self, channel))

    def inlet(self, channel: Channel, sink: Sink) -> Subscriber | CommandInlet:
        kind = Subscriber if channel.pattern is Pattern.PUBLISH else CommandInlet
        return self._open(kind(self, channel, sink))

    def caller(self, channel: Channel) -> Caller:
        return self._open(Caller(self, channel))

    def server(self, channel: Channel, service: Service) -> Server:
        return self._open(Server(self, channel, service))

    def close(self) -> None:
        with self._lock:
            if self.closed:
                return
            self.closed = True
        crew = self._crew
        assert crew
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            everything.callback(crew.close)
            everything.callback(self.communicator.destroy)
            everything.callback(self._close_peers)
            everything.callback(self.desk.close)
            everything.callback(self.member.close)
            for link in list(self._links):
                everything.callback(link.close)

    # What links use.

    def do(self, job: Job) -> None:
        """Have the crew run this. On any thread, also one of Ice's."""
        self._intake.put(lambda: (job,))

    def look_soon(self) -> None:
        self._next_tick = 0.0
        self._intake.put(tuple)

    def port(self, identity: str, endpoints: str, take: Take, ids: Callable[[], Iterable[str]] = tuple) -> Port:
        """An object of that identity, to which `take` is given what is asked of it; see `objects.Port`."""
        name = f"{identity} {next(self._numbers)}"
        return Port(self.communicator, name, identity, endpoints, ids, self._intake, self.limit, take)

    def enlist(self, link: ServingLink) -> str:
        prefix = link.channel.name.rpartition("/")[0]
        endpoints = self.options.endpoint_of(link.channel.name) or ""
        with self._lock:
            offer = self._offers.setdefault(prefix, Offer())
            offer.add(link)
            if offer.port is None:
                identity = iceoptions.identity_of(link.channel.name)
                offer.port = self.port(identity, endpoints, offer.take, offer.ids)
            return f"{self.limit} {offer.port.proxy}"

    def delist(self, link: ServingLink) -> None:
        offer = self._offers.get(link.channel.name.rpartition("/")[0])
        if offer:
            offer.remove(link)

    def let_go(self, link: ServingLink) -> None:
        """Nothing of it runs any more; with the last one its object goes."""
        prefix = link.channel.name.rpartition("/")[0]
        with self._lock:
            offer = self._offers.get(prefix)
            if offer is None:
                return
            offer.held.discard(link)
            if offer.held:
                return
            del self._offers[prefix]
        if offer.port:
            offer.port.close()

    def peer(self, member_id: str, address: str) -> Peer:
        with self._lock:
            if self.closed:
                raise Closed("the transport is closed")
            key = member_id, address
            if key not in self._peers:
                self._peers[key] = Peer(self, member_id, address)
            return self._peers[key]

    def drop(self, peer: Peer) -> None:
        """Its object is gone: nobody we wait for there will answer."""
        with self._lock:
            self._peers.pop((peer.id, peer.address), None)
        peer.close()

    # On threads of the crew.

    def _receive(self) -> Iterable[Job]:
        wait = self._next_tick - time.monotonic()
        if wait <= 0:
            self._next_tick = time.monotonic() + TICK  # what becomes due while we look is not missed
            wait = self._tick()
            self._next_tick = min(self._next_tick, time.monotonic() + wait)
        return self._intake.receive(wait)

    def _tick(self) -> float:
        """Do what is due; seconds until the next time."""
        if abandoned():
            log.warning("%s: not closed at the end of the program; closing", self.owner or "ice")
            self.close()
            return TICK
        version = self.directory.version()
        if version != self._known or time.monotonic() >= self._call_at:
            self._call_at = time.monotonic() + ROLL_CALL
            self._drop_the_dead()
        return min([TICK, *self._look_after(version)])

    def _drop_the_dead(self) -> None:
        """Let go of what we hold for processes that have ended, whether or not anybody asks them again."""
        with self._lock:
            peers = list(self._peers.values())
        for peer in peers:
            if not peer.alive():
                self.drop(peer)

    def _close_peers(self) -> None:
        with self._lock:
            peers = list(self._peers.values())
        for peer in peers:
            peer.close()

    def _tell(self, level: int, message: str) -> None:
        """What Ice has to say; see `library.communicator`."""
        self.do(partial(log.log, level, "%s: %s", self.owner or "ice", message))
