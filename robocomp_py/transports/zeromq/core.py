"""What the links of a ZeroMQ transport share: its options, its sockets, its members, and its threads."""

from __future__ import annotations

import contextlib
import logging
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, partial
from ipaddress import ip_address
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import zmq

from ...errors import (
    ConfigurationError,
)
from ...wire.codec import Codec
from ...wire.header import (
    random_id,
)
from ..base import (
    ANY_QOS,
    Capability,
    Channel,
    TransportConfig,
    options_of,
)
from ..directory import LONGEST_SOCKET
from ..inotify import Watch
from ..keyfiles import Rights
from ..leader_followers import Job, LeaderFollowers
from ..limits import IDLE_TICK
from ..link import L
from ..members import Entry, Member
from ..runtime_folder import runtime_dir
from ..server import ServingLink, ServingTransport
from .bounds import Kind
from .curve import ZAP, Curve, Gate, Secure, configured, why_not
from .deployment import ZeroMQDeployment
from .peer import Peer
from .reactor import Reactor
from .remote import ACQUAINTED, SILENT, Inquirer, Neighbours, at_far, host_of, is_far, read_record, record
from .server import Router
from .sockets import Socket, as_transport_error
from .topic_sockets import SharedSockets, publishing

log = logging.getLogger("robocomp.transport.zeromq")

_FROM_SUBSCRIBERS = {"RCVBUF": 16 * 1024, "RCVHWM": 2}
"""Octets from a subscriber that the kernel holds, and messages that ZeroMQ holds. ZeroMQ stores subscriptions as long
as the connection has more of them, so small queues end this sooner. With 1, CURVE fails (libzmq 4.3.5)."""

TICK = 0.05
"""Seconds between two looks at awaited peers, and into the directory if its changes are not reported."""

_MOMENT = 0.01
"""Seconds between two looks into a directory that keeps changing."""


@runtime_checkable
class Hearing(Protocol):
    """A subscriber; see `topics.Subscriber`."""

    def hears(self, member_id: str) -> bool:
        """Whether it is connected to its publishers of that member."""
        ...


class ZeroMQCore(ServingTransport):
    """The transport without the classes of its links."""

    capabilities = ANY_QOS | Capability.CROSS_PROCESS
    directory: Neighbours

    def __init__(self, config: TransportConfig) -> None:
        super().__init__()
        options = options_of(config, bind="", connect={}, keys="", curve_key="", curve_admitted="", curve_peers="")
        self._bind, connect = options["bind"], _addresses(options["connect"])
        self._curve = _curve_of(options, self._bind, connect)
        if self._bind or connect:
            self.capabilities |= Capability.CROSS_HOST
        self._gate = Gate(self._curve) if self._curve else None
        if self._bind and self._curve is None and not _is_loopback(self._bind):
            log.warning(
                "%s: listens at %s without keys: every host that reaches it may subscribe, call and command",
                config.owner or "zeromq",
                self._bind,
            )
        self._topic_ports: dict[str, str] = {}
        """By the address of a topic on this host: its address for other hosts."""
        self._told_entries: tuple[Entry, ...] = ()
        self._told_at = 0.0
        self.incarnation = random_id()
        self.owner, self.folder = config.owner, _short_enough(runtime_dir("zeromq"))
        self.served = self.folder / "served"
        self._routers: list[Router] = []
        self.directory = Neighbours(self.folder)
        self.member = self.directory.join(config.owner)
        try:
            self.reactor = Reactor(self._tick, config.owner)
        except BaseException:
            self.member.close()
            raise
        self.shared_sockets = SharedSockets(self.reactor, self.member)
        self._watch = Watch(self.folder)
        self.directory.watch(self._watch, self.reactor.wake)
        if self._watch.able:
            self.reactor.add(_Changes(self._watch, self.reactor))
        self._inquirers: list[Inquirer] = []
        self._opened = time.monotonic()
        """Since when we look for others, and, if we do, listen to them."""
        if self._bind or connect:
            self._reach_hosts(connect)
        self._threads = LeaderFollowers("zeromq", self.reactor.receive, self.reactor.wake)
        self._threads.start(self.close)

    def _reach_hosts(self, connect: Mapping[str, str]) -> None:
        """Guard connections from other hosts, and ask those at these addresses for what they serve."""
        try:
            self.reactor.start_guard()
            for name, address in connect.items():
                secure = self.secure_for(name)
                self._inquirers.append(
                    Inquirer(self.reactor, self.directory, self.owner, name, address, secure, self.record)
                )
        except BaseException:
            self._close_unstarted()
            raise

    def _close_unstarted(self) -> None:
        self.reactor.close_unstarted()
        self.member.close()
        self._watch.close()

    def release(self, everything: contextlib.ExitStack) -> None:
        everything.callback(self._watch.close)
        everything.callback(self.reactor.close)
        everything.callback(self.reactor.close_sockets)
        everything.callback(self.close_peers)
        everything.callback(self._threads.close)
        everything.callback(self._close_routers)
        everything.callback(self.member.close)
        everything.callback(self.directory.stop_watching)

    def _close_routers(self) -> None:
        for router in self._routers[1:]:
            router.tell(self._record_for)  # all links are closed: the record has no entries any more
        for router in self._routers:
            router.close()

    # What links use.

    def do(self, job: Job) -> None:
        """Have a receiving thread run this."""
        self.reactor.do(job)

    def routers(self) -> list[Router]:
        """The one for this host, and one for others."""
        with self._lock:
            self.check_open()  # otherwise its sockets would be left open, and the context could not be closed
            if not self._routers:
                here = f"ipc://{self.member.address('router')}"
                if self._bind:
                    self._routers = [self._far_router()]  # to be closed whatever happens to the other one
                self._routers = [Router(self.reactor, self.incarnation, [here], self.tell), *self._routers]
            return self._routers

    def enlist(self, link: ServingLink) -> str:
        routers = self.routers()
        for router in routers:
            router.add(link)
        return routers[0].address

    def delist(self, link: ServingLink) -> None:
        for router in self._routers:
            router.remove(link)

    @cached_property
    def codec(self) -> Codec:
        from ...wire.messagepack import MessagePack  # whether a transport opens is tried without it

        return MessagePack()

    @property
    def may_be_known(self) -> bool:
        """Whether remote members that looked for this transport before it opened have had time to find it."""
        return time.monotonic() >= self._opened + ACQUAINTED

    @property
    def knows_others(self) -> bool:
        """Whether all remote transports in `connect` have sent their record, or have had time to."""
        return all(each.knows for each in self._inquirers) or time.monotonic() >= self._opened + ACQUAINTED

    def hears(self, member_id: str) -> bool:
        """Whether all subscribers here are connected to their publishers of that member."""
        with self._lock:
            subscribers = [link for link in self._links if isinstance(link, Hearing)]
        return all(each.hears(member_id) for each in subscribers)

    def _far_router(self) -> Router:
        self._opened = time.monotonic()
        if self._curve is None or self._gate is None:
            return Router(self.reactor, self.incarnation, [self._bind], self.tell, introduce=self._introduce)
        asked = self.reactor.socket(zmq.REP, self._judge)
        try:
            with as_transport_error(f"guarding {self._bind}"), asked.lock:
                asked.raw.bind(ZAP)
                asked.look()  # what is done with a socket may swallow that there is input
            secure, gate = self._curve.serve, self._gate
            return Router(self.reactor, self.incarnation, [self._bind], self.tell, secure, self._introduce, gate)
        except BaseException:
            self.reactor.forget(asked)
            raise

    @property
    def bound(self) -> bool:
        """Whether other hosts may reach this transport."""
        return bool(self._bind)

    def far_topic(
        self, channel: Channel, here: str, ending: str, depth: int, on_input: Callable[[Socket], list[Job]]
    ) -> Socket:
        """The socket by which other hosts receive the topic at address `here`."""
        self.routers()  # opens the socket for requests of other hosts
        secure = partial(self._curve.serve, channel=channel.name) if self._curve else None
        options = at_far(self._bind) | publishing(depth) | _FROM_SUBSCRIBERS
        socket = self.reactor.socket(zmq.XPUB, on_input, secure, **options)
        try:
            self.reactor.watch(socket, Kind.SUBSCRIPTIONS)
            with as_transport_error(f"binding a port of {host_of(self._bind)}"), socket.lock:
                socket.raw.bind(f"tcp://{host_of(self._bind)}:*")
                bound = socket.raw.getsockopt_string(zmq.LAST_ENDPOINT)
        except BaseException:
            self.reactor.forget(socket)
            raise
        self._topic_ports[here] = f"tcp://*:{bound.rpartition(':')[2]}#{ending}"
        return socket

    def end_topic(self, here: str) -> None:
        self._topic_ports.pop(here, None)

    def secure_for(self, name: str) -> tuple[Secure | None, Rights]:
        """How to secure a connection to a name in `connect`, and its rights."""
        if self._curve is None:
            return None, Rights()
        key, rights = self._curve.peer(name)
        return self._curve.ask(key), rights

    def secure_to(self, member: Member) -> Secure | None:
        """How to secure a connection to a remote member."""
        name = member.id.partition("@")[0]
        return next((each.secure for each in self._inquirers if each.name == name), None)

    def record(self, allowed: Rights | None = None) -> bytes:
        """The own record, with the entries that the receiver has a right to."""
        told = [
            replace(entry, address=self._topic_ports.get(entry.address, ""))
            for entry in self.member.entries
            if allowed is None or allowed.allow(entry.channel)
        ]
        return record(self.member.id, self.owner, os.getpid(), told)

    def _introduce(self, payload: bytes, user: str) -> bytes:
        """The reply to a member that sent this record. Raises DecodeError."""
        member = read_record(payload, user or "tcp", at="", rights=self._rights(user))
        if self.directory.hear(member):
            self.reactor.wake()
        return self._record_for(user)

    def _record_for(self, user: str) -> bytes:
        return self.record(self._rights(user))

    def _rights(self, user: str) -> Rights:
        return self._gate.rights(user) if self._gate else Rights()

    def _tell_news(self) -> None:
        """Send the own record to other hosts if it has changed."""
        entries = self.member.entries
        if entries != self._told_entries:
            self._told_entries = entries
            for inquirer in self._inquirers:
                inquirer.ask_now()
            for router in self._routers[1:]:
                router.tell(self._record_for)

    def _judge(self, socket: Socket) -> list[Job]:
        while (frames := socket.receive()) is not None:
            if self._gate:
                socket.send(self._gate.judge(frames))
        return []

    def tell(self, event: list[bytes]) -> None:
        """Log that a connection was not let in, and why; at most once in a second."""
        if time.monotonic() >= self._told_at + 1:
            self._told_at = time.monotonic()
            log.warning("%s: a connection was refused: %s", self._bind, why_not(event))

    def peer(self, member: Member, address: str) -> Peer:
        def make() -> Peer:
            secure = self.secure_to(member) if is_far(address) else None
            return Peer(self.reactor, self.directory, member.id, address, secure)

        return self.asked(member.id, make)

    def _open(self, make: Callable[[], L]) -> L:
        link = super()._open(make)
        if not self.gathers:
            self.reactor.wake()
        return link

    def look_soon(self) -> None:
        self.reactor.wake()

    def _tick(self) -> float:
        """Do what is due; seconds until the next time."""
        if self.close_if_abandoned():
            return TICK
        self.directory.listen()
        held_back = False
        if self.directory.has_far_ones:
            self.directory.lose(lambda _: False)
            held_back = self.directory.settle(self.hears)
        version = self.directory.version()
        if self.is_roll_call(version):
            self.drop_the_dead()
        if self._bind or self._inquirers:
            self._tell_news()
        waits = self._look_after(version)
        waits += [inquirer.tick() for inquirer in self._inquirers]
        waits += [TICK] if held_back else [SILENT / 4] if self.directory.has_far_ones else []
        usual = self.directory.pause or IDLE_TICK if self._known == version else TICK
        return min([usual, *waits])


class _Changes:
    """Lets the loop watch the directory for changes."""

    awaited = False

    def __init__(self, watch: Watch, reactor: Reactor) -> None:
        self.fileno, self._watch, self._reactor = watch.fileno, watch, reactor

    def on_input(self, _: object) -> list[Job]:
        if self._watch.read():
            self._reactor.within(_MOMENT)
        return []

    def look(self) -> None:
        """Nothing to do: the descriptor reports input as long as there is some."""

    def close(self) -> None:
        self._watch.close()


def _curve_of(options: Mapping[str, Any], bind: str, connect: Mapping[str, str]) -> Curve | None:
    """The keys for connections with other hosts; None without keys. Raises ConfigurationError."""
    has_others = bool(bind or connect)
    if options["keys"] and not has_others:
        return None  # the keys of its network, although all its links stay on this host
    curve = configured(options)
    if curve and not has_others:
        raise ConfigurationError(
            "zeromq: `curve_key` is for the addresses that `bind` and `connect` name, and there are none"
        )
    if curve and bind and not curve.admitted:
        raise ConfigurationError("zeromq: `bind` with keys needs `curve_admitted`: the keys of admitted clients")
    return curve


def _addresses(given: Any) -> dict[str, str]:
    """What `connect` says. Raises ConfigurationError."""
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"zeromq: `connect` is a table of addresses under names, not {given!r}")
    for name, address in given.items():
        if not isinstance(address, str) or host_of(address) in ("", "*"):
            raise ConfigurationError(
                f"zeromq: `connect.{name}` is an address like tcp://192.168.1.5:7501, not {address!r}"
            )
    return dict(given)


def _is_loopback(address: str) -> bool:
    try:
        return host_of(address) == "localhost" or ip_address(host_of(address).strip("[]")).is_loopback
    except ValueError:
        return False


def _short_enough(folder: Path) -> Path:
    """The folder, if the paths of sockets in it are not too long for the kernel."""
    longest = len(os.fsencode(folder.parent / ZeroMQDeployment.longest_socket))
    if longest > LONGEST_SOCKET:
        raise ConfigurationError(
            f"run-time folder {folder}: paths of sockets in it would have {longest} bytes, and {LONGEST_SOCKET} is the "
            "limit; set ROBOCOMP_RUNTIME_DIR to a shorter path"
        )
    return folder
