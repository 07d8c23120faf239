"""What the links of an Ice transport share: its communicator, its objects, and its threads."""

from __future__ import annotations

import contextlib
import itertools
import logging
import time
from collections.abc import Callable, Iterable
from functools import partial

from ...wire.codec import MAX_BYTES, Codec
from ...wire.ice import Ice
from .. import iceoptions
from ..base import ANY_QOS, Capability, SupportsHost, TransportConfig
from ..directory import Directory
from ..leader_followers import Job, LeaderFollowers
from ..memory import keep_memory
from ..runtime_folder import runtime_dir
from ..server import ServingLink, ServingTransport
from .library import communicator
from .objects import Intake, Port, Take
from .peer import Peer
from .served import RequestQueue, ServedObject
from .storm import hosted
from .topic_service import TopicService

log = logging.getLogger("robocomp.transport.ice")

TICK = 0.25
"""Seconds between two ticks."""


class IceCore(ServingTransport, SupportsHost):
    """The transport without the classes of its links."""

    capabilities = ANY_QOS | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        super().__init__()
        self.options = iceoptions.read(config.options)
        self.limit = self.options.message_size_max or MAX_BYTES
        """Maximum size of a whole message in bytes."""
        if self.options.endpoints or self.options.proxies or self.options.host != iceoptions.HOST:
            self.capabilities |= Capability.CROSS_HOST
        self.codec: Codec = Ice()
        self.owner, self.wanted = config.owner, config.wanted
        self.folder = runtime_dir("ice")
        self.served = self.folder / "served"
        self.directory = Directory(self.folder)
        self._numbers = itertools.count(1)
        self._offers: dict[str, ServedObject] = {}
        self._intake = Intake()
        self.requests = RequestQueue(self.do)
        self._next_tick = 0.0
        self._threads: LeaderFollowers | None = None
        keep_memory()
        self.communicator = communicator(self.options, self.limit, self._tell)
        try:
            self.member = self.directory.join(config.owner)
        except BaseException:
            self.communicator.destroy()
            raise
        self.topic_service = TopicService(self)
        self._threads = LeaderFollowers("ice", self._receive, wake=self.look_soon)
        self._threads.start(self.close)

    @staticmethod
    def host(config: TransportConfig) -> contextlib.AbstractContextManager[None]:
        """See `base.SupportsHost`: run IceStorm, unless it is running already, or is elsewhere."""
        return hosted(iceoptions.read(config.options), config.owner)

    def release(self, everything: contextlib.ExitStack) -> None:
        assert self._threads
        everything.callback(self._threads.close)
        everything.callback(self.communicator.destroy)
        everything.callback(self.close_peers)
        everything.callback(self.topic_service.close)
        everything.callback(self.member.close)

    # What links use.

    def do(self, job: Job) -> None:
        """Run a job on one of our threads. Safe to use from any thread, also from Ice's."""
        self._intake.put(lambda: (job,))

    def look_soon(self) -> None:
        self._next_tick = 0.0
        self._intake.put(tuple)

    def port(self, identity: str, endpoints: str, take: Take, ids: Callable[[], Iterable[str]] = tuple) -> Port:
        """An object of that identity; `take` gets its invocations. See `objects.Port`."""
        name = f"{identity} {next(self._numbers)}"
        return Port(self.communicator, name, identity, endpoints, ids, self._intake, self.limit, take)

    def enlist(self, link: ServingLink) -> str:
        prefix = link.channel.name.rpartition("/")[0]
        endpoints = self.options.endpoint_of(link.channel.name) or ""
        with self._lock:
            offer = self._offers.setdefault(prefix, ServedObject())
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
        """Release a link without running handlers; the object ends with its last link."""
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
        make = partial(Peer, self.communicator, self.limit, self.directory, member_id, address)
        return self.asked((member_id, address), make)

    # On our own threads.

    def _receive(self) -> Iterable[Job]:
        wait = self._next_tick - time.monotonic()
        if wait <= 0:
            self._next_tick = time.monotonic() + TICK  # `due` may set an earlier time during the tick
            wait = self.tick()
            self._next_tick = min(self._next_tick, time.monotonic() + wait)
        return self._intake.receive(wait)

    def _tell(self, level: int, message: str) -> None:
        """Log a message of Ice; see `library.communicator`."""
        self.do(partial(log.log, level, "%s: %s", self.owner or "ice", message))
