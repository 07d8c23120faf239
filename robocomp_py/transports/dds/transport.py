"""The transport: its links, and the thread that looks after them."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable, Set
from typing import Any, TypeVar

from ...contract.interface import Pattern
from ...errors import (
    Closed,
    ConfigurationError,
    TransportError,
)
from ...wire.codec import Codec
from ...wire.header import random_id
from ..base import (
    ANY_QOS,
    Capability,
    Channel,
    Service,
    Sink,
    TransportConfig,
    options_of,
)
from ..crew import Crew, abandoned
from ..directory import runtime_dir
from .announcing import Announcing
from .asking import Caller, CommandOutlet
from .bus import Bus
from .endpoints import concerned
from .link import Link
from .serving import CommandInlet, Server
from .topics import Publisher, Subscriber
from .types import (
    CODEC,
)

log = logging.getLogger("robocomp.transport.dds")

LAST_DOMAIN = 230
"""Of higher ones the ports would be none."""

FIRST_USER = 1000
"""The number that Linux gives to the first user of a machine who is neither root nor a service."""

TICK = 0.5
"""Seconds between two looks whether somebody forgot to close us."""

L = TypeVar("L", bound=Link)


def domain_of_user(number: int) -> int:
    """Where those of a user meet on a host that others use, too: 0, as every tool has it, but for the second one on.

    Root, services and the first user share it, as do users whose numbers differ by how many domains there are.
    """
    return max(0, number - FIRST_USER) % (LAST_DOMAIN + 1)


class DDSTransport:
    """Options:

    `domain`      a number; of the user, on this host alone, else 0
    `interface`   its name, or its IPv4 address: "lo" is this host alone; "" lets Cyclone DDS choose
    `peers`       addresses of the hosts to meet, this one among them, instead of looking for them by multicast
    `many`        whether more than a few dozen processes meet; `rcdeploy` says so
    """

    capabilities = ANY_QOS | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        options = options_of(config, domain=None, interface="lo", peers=[], many=False)
        domain, interface = options["domain"], options["interface"]
        if domain is None:
            domain = domain_of_user(os.getuid()) if interface == "lo" else 0
        if type(domain) is not int or not 0 <= domain <= LAST_DOMAIN:
            raise ConfigurationError(f"transport option `domain` is a number from 0 to {LAST_DOMAIN}, not {domain!r}")
        if type(interface) is not str:
            raise ConfigurationError(f"transport option `interface` is a name like 'lo', not {interface!r}")
        peers = options["peers"]
        if not isinstance(peers, list) or not all(isinstance(peer, str) for peer in peers):
            raise ConfigurationError(f"transport option `peers` is a list of addresses, not {peers!r}")
        many = options["many"]
        if type(many) is not bool:
            raise ConfigurationError(f"transport option `many` is true or false, not {many!r}")
        self.local = interface == "lo"
        """Whether all are on this host."""
        if not self.local:
            self.capabilities |= Capability.CROSS_HOST
        self.codec: Codec = CODEC
        self.owner = config.owner
        self.incarnation = random_id()
        self.folder = runtime_dir() / "dds" / f"served-{domain}"
        """For claims of those who can meet."""
        self.closed = False
        self._lock = threading.RLock()
        self._links: list[Link] = []
        self._ids: set[int] = set()
        self.gone = "the link is closed"
        self.bus = Bus(domain, interface, tuple(peers), many)
        self.announcing = Announcing(self.bus)
        self.gathering = self.announcing.gathering
        self.bus.on_loss = self._lose
        self.bus.endpoints.on_change = self._look
        self.bus.loop.tick = self._tick
        self._crew = Crew("dds", self.bus.loop.receive, self.bus.loop.wake)
        try:
            self._crew.start()
        except RuntimeError as exc:
            self._crew.close()
            self.bus.close()
            raise TransportError(f"dds: cannot be opened: {exc}; allow for more threads (`ulimit -u`)") from exc

    def outlet(self, channel: Channel) -> Publisher | CommandOutlet:
        kind = Publisher if channel.pattern is Pattern.PUBLISH else CommandOutlet
        return self._open(lambda: kind(self, channel))

    def inlet(self, channel: Channel, sink: Sink) -> Subscriber | CommandInlet:
        kind = Subscriber if channel.pattern is Pattern.PUBLISH else CommandInlet
        return self._open(lambda: kind(self, channel, sink))

    def caller(self, channel: Channel) -> Caller:
        return self._open(lambda: Caller(self, channel))

    def server(self, channel: Channel, service: Service) -> Server:
        return self._open(lambda: Server(self, channel, service))

    def close(self) -> None:
        with self._lock:
            if self.closed:
                return
            self.closed = True
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            everything.callback(self.bus.close)
            everything.callback(self._crew.close)
            everything.enter_context(self.gathering())
            for link in list(self._links):
                everything.callback(link.close)

    def new_id(self) -> int:
        """A number for a link of ours."""
        number = random_id()
        self._ids.add(number)
        return number

    def owns(self, link: int) -> bool:
        """Whether a link of that number is one of ours."""
        return link in self._ids

    def left(self, link: Link) -> None:
        with self._lock:
            self._ids.discard(link.id)
            if link in self._links:
                self._links.remove(link)

    def _open(self, make: Callable[[], L]) -> L:
        if self.closed:
            raise Closed(f"the transport is closed: {self.gone}" if self.bus.lost else "the transport is closed")
        link = make()
        try:
            link.open()
            with self._lock:
                self._links.append(link)
            link.look()  # at those who were there before; those who come now are reported to all in the list
        except BaseException:
            link.close()
            raise
        if self.closed:
            link.close()
            raise Closed("the transport is closed")
        return link

    def _lose(self) -> None:
        """In a process forked from ours, where nothing of this works."""
        self.closed = True
        self._lock = threading.RLock()  # the former one may be held by a thread that is not here
        self.gone = "it was opened before this process was forked, which has to open its own"
        for link in self._links:
            link.lose()

    # On the receiving thread, which must go on whatever happens.

    def _look(self, changed: Set[str]) -> None:
        for link in list(self._links):
            if concerned(link.channel.name, changed):
                with self._guarded(link):
                    link.look()

    def _tick(self) -> float:
        if abandoned():
            log.warning("%s: not closed at the end of the program; closing", self.owner or "dds")
            self.close()
            return float("inf")
        due = time.monotonic() + TICK
        for link in list(self._links):
            with self._guarded(link):
                due = min(due, link.tick())
        return due

    @contextlib.contextmanager
    def _guarded(self, link: Link) -> Any:
        try:
            yield
        except Exception:
            if not link.closed.is_set():
                log.exception("%s: looking at who is there", link.channel.name)
