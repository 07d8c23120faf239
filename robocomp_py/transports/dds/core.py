"""What the links of a DDS transport share: its options, its bus, and its threads."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import threading
import time
from collections.abc import Iterator, Set

from ...errors import (
    ConfigurationError,
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
from ..directory import Directory
from ..leader_followers import Job, LeaderFollowers
from ..link import BaseTransport
from ..members import Entry
from ..membership import Membership
from ..runtime_folder import runtime_dir
from .announcing import Announcing
from .bus import Bus
from .endpoints import Endpoint, concerned
from .limits import DEFAULTS, limits_of

log = logging.getLogger("robocomp.transport.dds")

LAST_DOMAIN = 230
"""Ports of higher domains would exceed 65535."""

FIRST_USER = 1000
"""The user id that Linux gives to the first ordinary user."""

DISCOVERY = 0.5
"""Seconds that a new publisher or subscriber allows for the discovery of peers on other hosts."""

TICK = 0.5
"""Seconds between two checks whether the program has ended without closing this transport."""


def domain_of_user(number: int) -> int:
    """A user's default domain: 0 for root, services and the first user, another one for each further user.

    Users share a domain if their ids differ by a multiple of the number of domains.
    """
    return max(0, number - FIRST_USER) % (LAST_DOMAIN + 1)


class DDSCore(BaseTransport[Endpoint], SupportsGathering):
    """The transport without the classes of its links."""

    capabilities = ANY_QOS | Capability.CROSS_PROCESS

    def __init__(self, config: TransportConfig) -> None:
        super().__init__()
        options = options_of(config, domain=None, interface="lo", peers=[], many=False, **DEFAULTS)
        domain, interface = options["domain"], options["interface"]
        if domain is None:
            domain = domain_of_user(os.getuid()) if interface == "lo" else 0
        if type(domain) is not int or not 0 <= domain <= LAST_DOMAIN:
            raise ConfigurationError(
                f"transport option `domain` must be an integer from 0 to {LAST_DOMAIN}, not {domain!r}"
            )
        if type(interface) is not str:
            raise ConfigurationError(f"transport option `interface` must be a name like 'lo', not {interface!r}")
        peers = options["peers"]
        if not isinstance(peers, list) or not all(isinstance(peer, str) for peer in peers):
            raise ConfigurationError(f"transport option `peers` must be a list of addresses, not {peers!r}")
        many = options["many"]
        if type(many) is not bool:
            raise ConfigurationError(f"transport option `many` must be true or false, not {many!r}")
        self.limits = limits_of(options)
        """The limits of the readers and writers of topics."""
        self.local = interface == "lo"
        """Whether the domain is limited to this host."""
        if not self.local:
            self.capabilities |= Capability.CROSS_HOST
        self.owner = config.owner
        self.incarnation = random_id()
        self._domain = domain
        self.folder = runtime_dir("dds", f"served-{domain}")
        """The folder for claims; components that can meet use the same one."""
        self._ids: set[int] = set()
        self.bus = Bus(domain, interface, tuple(peers), many)
        self.announcing = Announcing(self.bus)
        self._gathering: contextlib.ExitStack | None = None
        self._discovered_at = 0.0 if self.local else time.monotonic() + DISCOVERY
        self._directory: Directory | None = None
        self._member: Membership | None = None
        """Announces our ends of topics to components of this host. Made with the first one, if the domain is local."""
        self.bus.on_loss = self._lose
        self.bus.endpoints.on_change = self._look
        self.bus.loop.tick = self._tick
        self._threads = LeaderFollowers("dds", self.bus.loop.receive, self.bus.loop.wake)
        self._threads.start(self.bus.close)

    def release(self, everything: contextlib.ExitStack) -> None:
        if self._member:
            everything.callback(self._member.close)
        everything.callback(self.bus.close)
        everything.callback(self._threads.close)
        everything.enter_context(self.announcing.gathering())

    @property
    def codec(self) -> Codec:
        from .types import CODEC  # it makes a type, which a census does without

        return CODEC

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        """See `base.SupportsGathering`."""
        with contextlib.ExitStack() as gathering:
            gathering.enter_context(self.announcing.gathering())
            if self._member:
                gathering.enter_context(self._member.gathered())
            self._gathering = gathering
            try:
                yield
            finally:
                with self._lock:  # before it ends: another thread must not add to it afterwards
                    self._gathering = None

    @property
    def has_discovered(self) -> bool:
        """Whether DDS has had the time to find the peers that were there before us.

        DDS does not report when it has. On this host the run-time folder lists them, so there is no need to wait.
        """
        return time.monotonic() >= self._discovered_at

    def announce_here(self, role: str, channel: Channel, number: int) -> Entry | None:
        """Announce an end of a topic to the components of this host, before DDS does."""
        if not self.local:
            return None
        with self._lock:
            self.check_open()  # otherwise the member would be left open
            if self._directory is None or self._member is None:
                self._directory = Directory(self.folder.parent)
                self._member = self._directory.join(self.owner)
                if self._gathering:
                    self._gathering.enter_context(self._member.gathered())
        entry = Entry(self._of_domain(role), channel.name, channel.type.fingerprint, "", f"{number:016x}")
        self._member.add(entry)
        return entry

    def withdraw_here(self, entry: Entry) -> None:
        if self._member:
            self._member.remove(entry)

    def announced_here(self, role: str, channel: Channel) -> set[int]:
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
        """An id for a new link."""
        number = random_id()
        self._ids.add(number)
        return number

    def drop_id(self, number: int) -> None:
        """A link was closed."""
        self._ids.discard(number)

    def find(self, role: str, channel: str) -> list[Endpoint]:
        return self.bus.endpoints.find(role, channel)

    def is_own(self, peer: Endpoint) -> bool:
        return peer.id in self._ids

    def _lose(self) -> None:
        """Close this transport in a forked process, where it cannot work."""
        self.closed = True
        self._lock = threading.RLock()  # a thread that is missing may hold the old one
        self.gone = "it was opened before this process was forked; open a new transport in the child"
        for link in self._links:
            link.lose()

    # On the receiving thread, which no exception may end.

    def _look(self, changed: Set[str]) -> None:
        for link in list(self._links):
            if concerned(link.channel.name, changed):
                self._guarded(link.look, False)

    def _tick(self) -> float:
        if self.close_if_abandoned():
            return math.inf
        return time.monotonic() + min([TICK, *self.tick_links()])
