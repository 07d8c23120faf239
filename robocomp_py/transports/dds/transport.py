"""The transport: its links, and the thread that looks after them."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from collections.abc import Iterator, Set
from typing import Any

from ...errors import (
    ConfigurationError,
    TransportError,
)
from ...wire.codec import Codec
from ...wire.header import random_id
from ..base import (
    ANY_QOS,
    Capability,
    Channel,
    SupportsGathering,
    TransportConfig,
    options_of,
)
from ..directory import Directory, Entry, Membership, runtime_dir
from ..leader_followers import Job, LeaderFollowers
from ..link import BaseLink, BaseTransport, Ends
from .announcing import Announcing
from .bus import Bus
from .client import Caller, CommandOutlet
from .endpoints import Endpoint, concerned
from .limits import DEFAULTS, limits_of
from .link import Link
from .server import CommandInlet, Server
from .topics import Publisher, Subscriber
from .types import (
    CODEC,
)

log = logging.getLogger("robocomp.transport.dds")

LAST_DOMAIN = 230
"""Of higher ones the ports would be none."""

FIRST_USER = 1000
"""The number that Linux gives to the first user of a machine who is neither root nor a service."""

DISCOVERY = 0.5
"""Seconds that DDS is given to find those on other hosts that a new publisher, or subscriber, is to be connected to."""

TICK = 0.5
"""Seconds between two looks whether somebody forgot to close us."""


def domain_of_user(number: int) -> int:
    """Where those of a user meet on a host that others use, too: 0, as every tool has it, but for the second one on.

    Root, services and the first user share it, as do users whose numbers differ by how many domains there are.
    """
    return max(0, number - FIRST_USER) % (LAST_DOMAIN + 1)


class DDSTransport(BaseTransport[Endpoint], SupportsGathering):
    """Options:

    `domain`      a number; of the user, on this host alone, else 0
    `interface`   its name, or its IPv4 address: "lo" is this host alone; "" lets Cyclone DDS choose
    `peers`       addresses of the hosts to meet, this one among them, instead of looking for them by multicast
    `many`        whether more than a few dozen processes meet; `rcdeploy` says so

    and those of `limits.Limits`.
    """

    ends = Ends(Publisher, CommandOutlet, Subscriber, CommandInlet, Caller, Server)
    capabilities = ANY_QOS | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        super().__init__()
        options = options_of(config, domain=None, interface="lo", peers=[], many=False, **DEFAULTS)
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
        self.limits = limits_of(options)
        """Of the readers and writers of topics."""
        self.local = interface == "lo"
        """Whether all are on this host."""
        if not self.local:
            self.capabilities |= Capability.CROSS_HOST
        self.codec: Codec = CODEC
        self.owner = config.owner
        self.incarnation = random_id()
        self._domain = domain
        self.folder = runtime_dir("dds", f"served-{domain}")
        """For claims of those who can meet."""
        self._ids: set[int] = set()
        self.bus = Bus(domain, interface, tuple(peers), many)
        self.announcing = Announcing(self.bus)
        self._gathering: contextlib.ExitStack | None = None
        self._discovered_at = 0.0 if self.local else time.monotonic() + DISCOVERY
        self._directory: Directory | None = None
        self._member: Membership | None = None
        """By which components of this host know of each other's ends of topics; once we have one, if all are here."""
        self.bus.on_loss = self._lose
        self.bus.endpoints.on_change = self._look
        self.bus.loop.tick = self._tick
        self._threads = LeaderFollowers("dds", self.bus.loop.receive, self.bus.loop.wake)
        try:
            self._threads.start()
        except TransportError:
            self.bus.close()
            raise

    def release(self, everything: contextlib.ExitStack) -> None:
        if self._member:
            everything.callback(self._member.close)
        everything.callback(self.bus.close)
        everything.callback(self._threads.close)
        everything.enter_context(self.announcing.gathering())

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        """See `base.SupportsGathering`."""
        with contextlib.ExitStack() as self._gathering:
            self._gathering.enter_context(self.announcing.gathering())
            if self._member:
                self._gathering.enter_context(self._member.gathered())
            yield
        self._gathering = None

    @property
    def has_discovered(self) -> bool:
        """Whether DDS has had the time to find the peers that were there before us.

        DDS does not report when it has. On this host the run-time folder lists them, so there is no need to wait.
        """
        return time.monotonic() >= self._discovered_at

    def tell_neighbours(self, link: Link) -> Entry | None:
        """Announce an end of a topic to the components of this host, before DDS does."""
        if not self.local:
            return None
        with self._lock:
            if self._directory is None or self._member is None:
                self._directory = Directory(self.folder.parent)
                self._member = self._directory.join(self.owner)
                if self._gathering:
                    self._gathering.enter_context(self._member.gathered())
        entry = Entry(
            self._of_domain(link.role), link.channel.name, link.channel.type.fingerprint, "", f"{link.id:016x}"
        )
        self._member.add(entry)
        return entry

    def leave_neighbours(self, entry: Entry) -> None:
        if self._member:
            self._member.remove(entry)

    def neighbours(self, role: str, channel: Channel) -> set[int]:
        """The ids of ends of a topic that components of this host have announced."""
        if self._directory is None or self._member is None:
            return set()
        return {
            int(entry.address, 16)
            for member, entry in self._directory.find(self._of_domain(role), channel.name)
            if entry.fingerprint == channel.type.fingerprint
            and (entry.channel == channel.name or member.id != self._member.id)
            and self._directory.alive(member.id)
        }

    def _of_domain(self, role: str) -> str:
        """A role as the run-time folder, which all domains share, writes it."""
        return f"{role} {self._domain}"

    def do(self, job: Job) -> None:
        self.bus.loop.do(job)

    def new_id(self) -> int:
        """A number for a link of ours."""
        number = random_id()
        self._ids.add(number)
        return number

    def find(self, role: str, channel: str) -> list[Endpoint]:
        return self.bus.endpoints.find(role, channel)

    def is_own(self, peer: Endpoint) -> bool:
        return peer.id in self._ids

    def left(self, link: BaseLink[Any, Endpoint]) -> None:
        super().left(link)
        if isinstance(link, Link):
            self._ids.discard(link.id)

    def _lose(self) -> None:
        """In a process forked from ours, where nothing of this works."""
        self.closed = True
        self._lock = threading.RLock()  # the former one may be held by a thread that is not here
        self.gone = "it was opened before this process was forked, which has to open its own"
        for link in self._links:
            if isinstance(link, Link):
                link.lose()

    # On the receiving thread, which must go on whatever happens.

    def _look(self, changed: Set[str]) -> None:
        for link in list(self._links):
            if concerned(link.channel.name, changed):
                self._guarded(link.look, False)

    def _tick(self) -> float:
        if self.close_if_abandoned():
            return float("inf")
        return time.monotonic() + min([TICK, *self.tick_links()])
