"""How instances on several hosts find each other: pure, from where they run and who uses whom.

    zeromq    who is used from elsewhere binds at its host's address; who uses it is told where
    zenoh     one router a host, run by the agent there; routers are connected to each other, components to theirs
    ice       see `iceplaces`
    dds       those that reach each other over DDS are on their host's address, and know the other hosts; no multicast

Only what crosses between hosts leaves loopback: who is used on its own host alone gets no setting. Shared memory and
`inproc` never cross. Ports follow from the network's name and the order of its instances, so that a restarted one is
found where it was, and a firewall can be told; an instance may be given another one (`port`).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ..runtime.effective import toml
from .auto import INPROC, SHM, Way
from .routes import Fault

ZEROMQ, ZENOH, DDS, ICE = "zeromq", "zenoh", "dds", "ice"

FIRST_PORT, BLOCK, BLOCKS = 20000, 100, 100
"""Each network has a block of ports, below those that systems give away: the router's, then one an instance."""

DDS_DOMAIN = 100
"""And a domain, from this one on, which programs that nobody configured are not in."""


@dataclass(frozen=True)
class Site:
    """An instance, and where it runs."""

    instance: str
    process: str
    host: str = ""
    """"" is the machine that launches the network."""
    port: int = 0
    """At which it is to be reached, if somebody says so."""
    is_program: bool = False
    """Whether it is a program of somebody's own, which is not configured from here."""


@dataclass(frozen=True)
class Network:
    name: str
    addresses: Mapping[str, str]
    """By host: at which number the others reach it."""
    sites: Sequence[Site]
    """In the order in which they start."""
    ways: Sequence[Way]
    encrypted: bool = False
    """Whether routers speak TLS, with each other and with their components."""


@dataclass(frozen=True)
class Wiring:
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By instance, `key=value`."""
    routers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """By host, if it has a Zenoh router: options for who runs it, see `transports.zenoh`."""
    faults: tuple[Fault, ...] = ()


def wire(network: Network) -> Wiring:
    """The settings that let instances on several hosts meet, and what is wrong with that."""
    return _Wirer(network).wire()


CROWD = 24
"""More instances than these that meet over DDS are told so, for each of them talks to all others."""


def with_crowds(wiring: Wiring, ways: Iterable[Way], settled: Collection[str] = ()) -> Wiring:
    """The same, if so many meet over DDS, with settings that make that bearable.

    `settled` are those of whom somebody has said already whether many meet.
    """
    there = {end for way in ways if way.middleware == DDS for end in (way.client, way.provider)}
    if len(there) <= CROWD:
        return wiring
    more = {
        name: (*wiring.settings.get(name, ()), "transports.dds.many=true") for name in sorted(there.difference(settled))
    }
    return replace(wiring, settings={**wiring.settings, **more})


class _Wirer:
    def __init__(self, network: Network) -> None:
        self._network = network
        self._sites = {site.instance: site for site in network.sites}
        self._processes = list(dict.fromkeys(site.process for site in network.sites))
        self._faults: list[Fault] = []

    def wire(self) -> Wiring:
        crossing = list(self.crossing())
        for way in crossing:
            self._check(way)
        self._check_routers([way for way in crossing if way.middleware == ZENOH])
        if self._faults:
            return Wiring(faults=tuple({fault.message: fault for fault in self._faults}.values()))
        by_name: dict[str, list[str]] = {}
        for found in (self._zeromq(crossing), self._zenoh(crossing), self._dds(crossing)):
            for instance, assignment in found:
                by_name.setdefault(instance, []).append(assignment)
        return Wiring({name: tuple(given) for name, given in by_name.items()}, dict(self._routers(crossing)))

    def crossing(self) -> Iterator[Way]:
        for way in self._network.ways:
            client, provider = self._sites.get(way.client), self._sites.get(way.provider)
            if client and provider and client.host != provider.host:
                yield way

    # What is wrong.

    def _check(self, way: Way) -> None:
        ends = self._sites[way.client], self._sites[way.provider]
        between = f"`{way.client}` ({_place(ends[0].host)}) and `{way.provider}` ({_place(ends[1].host)})"
        if way.middleware in (INPROC, SHM):
            what = f"`{way.middleware}` does not reach other hosts, and is to carry `{way.interface}` between {between}"
            hint = f"name another one, {ZEROMQ} say, or leave it open"
            self._fault(way, "unfit-middleware", what, hint)
        elif way.middleware not in (ZEROMQ, ZENOH, DDS, ICE, ""):  # "": not generated yet, which is said elsewhere
            what = f"`{way.middleware}` is to carry `{way.interface}` between {between}, which is not wired from here"
            self._fault(way, "unfit-middleware", what, f"name {ZEROMQ}, {ZENOH} or {DDS}")
        elif way.middleware == DDS and any(":" in self._address(end) for end in ends):
            what = f"`dds` is wired between IPv4 addresses only, and is to carry `{way.interface}` between {between}"
            self._fault(way, "unfit-middleware", what, "give the hosts such addresses")

    def _check_routers(self, ways: Sequence[Way]) -> None:
        first: dict[str, str] = {}
        for host in self._hosts(ways):
            address = self._network.addresses[host]
            other = first.setdefault(address, host)
            if other != host:
                way = next(each for each in ways if host in self._hosts([each]))
                both = f"{_place(other)} and {_place(host)}, which are both at {address}"
                what = f"`{ZENOH}` needs a router {both}: only one of the two can listen there"
                hint = f"make them one `host`, or name another middleware than `{ZENOH}`, {ZEROMQ} say"
                self._fault(way, "unfit-middleware", what, hint)

    def _fault(self, way: Way, code: str, message: str, hint: str) -> None:
        self._faults.append(Fault(code, message, hint, way.client, other=way.provider, port=way.port))

    # ZeroMQ.

    def _zeromq(self, crossing: Sequence[Way]) -> Iterator[tuple[str, str]]:
        ways = [way for way in crossing if way.middleware == ZEROMQ]
        for site in self._configured():  # also those of one process have each their own
            if any(way.provider == site.instance for way in ways):
                yield site.instance, f"transports.zeromq.bind={toml(self._bind(site))}"
            used = sorted({way.provider for way in ways if way.client == site.instance})
            if used:
                there = {provider: self._bind(self._sites[provider]) for provider in used}
                yield site.instance, f"transports.zeromq.connect={toml(there)}"

    def _bind(self, site: Site) -> str:
        port = site.port or self._base() + 1 + list(self._sites).index(site.instance)
        return f"tcp://{_bracketed(self._address(site))}:{port}"

    # Zenoh.

    def _zenoh(self, crossing: Sequence[Way]) -> Iterator[tuple[str, str]]:
        hosts = self._hosts(way for way in crossing if way.middleware == ZENOH)
        users = {end for way in self._network.ways if way.middleware == ZENOH for end in (way.client, way.provider)}
        processes = {self._sites[each].process for each in users if each in self._sites}
        for site in self._configured():
            if site.host in hosts and site.process in processes:
                yield site.instance, f"transports.zenoh.connect={toml(self._router_here())}"

    def _routers(self, crossing: Sequence[Way]) -> Iterator[tuple[str, Mapping[str, Any]]]:
        hosts = self._hosts(way for way in crossing if way.middleware == ZENOH)
        for number, host in enumerate(hosts):
            others = [self._router_of(other) for other in hosts[:number]]  # of two, one connects
            listen = [self._router_of(host), *([self._router_here()] if self._network.encrypted else [])]
            yield (
                host,
                {
                    "connect": f"here/{self._network.name}",
                    "router": {"listen/endpoints": listen, "connect/endpoints": others},
                },
            )

    def _router_here(self) -> str:
        """How the components of a host reach their router."""
        return f"tls/127.0.0.1:{self._base()}" if self._network.encrypted else f"here/{self._network.name}"

    def _router_of(self, host: str) -> str:
        kind = "tls" if self._network.encrypted else "tcp"
        return f"{kind}/{_bracketed(self._network.addresses[host])}:{self._base()}"

    # DDS.

    def _dds(self, crossing: Sequence[Way]) -> Iterator[tuple[str, str]]:
        meeting = _together(
            (self._sites[way.client].process, self._sites[way.provider].process)
            for way in self._network.ways
            if way.middleware == DDS and {way.client, way.provider} <= self._sites.keys()
        )
        for processes in meeting:
            sites = [site for site in self._network.sites if site.process in processes]
            hosts = list(dict.fromkeys(site.host for site in sites))
            if len(hosts) < 2:
                continue
            peers = toml([self._network.addresses[host] for host in hosts])
            for site in sites:
                if not site.is_program:
                    yield site.instance, f"transports.dds.domain={DDS_DOMAIN + self._block()}"
                    yield site.instance, f"transports.dds.interface={toml(self._address(site))}"
                    yield site.instance, f"transports.dds.peers={peers}"

    # What all need.

    def _configured(self) -> Iterator[Site]:
        return (site for site in self._network.sites if not site.is_program)

    def _hosts(self, ways: Iterable[Way]) -> list[str]:
        found = {self._sites[end].host for way in ways for end in (way.client, way.provider)}
        return [host for host in self._network.addresses if host in found]

    def _address(self, site: Site) -> str:
        return self._network.addresses[site.host]

    def _base(self) -> int:
        return FIRST_PORT + self._block() * BLOCK

    def _block(self) -> int:
        return block_of(self._network.name)


def first_free_port(network: str, instances: int) -> int:
    """The first port of a network's block that is none of its router or its instances."""
    return FIRST_PORT + block_of(network) * BLOCK + 1 + instances


def block_of(network: str) -> int:
    """The number of the block of ports that a name gives a network."""
    return zlib.crc32(network.encode()) % BLOCKS


def addresses_of(
    hosts: Mapping[str, str], resolve: Callable[[str], str], towards: Callable[[str], str]
) -> dict[str, str]:
    """By host, also this one, the number at which the others reach it.

    `resolve` gives the number of a name, and `towards` our own number on the way to one; both raise OSError.
    """
    found = {name: resolve(address) for name, address in hosts.items()}
    return {"": towards(next(iter(found.values()))), **found} if found else {}


def _together(pairs: Iterable[tuple[str, str]]) -> list[set[str]]:
    """Those that are connected by pairs, whole."""
    groups: list[set[str]] = []
    for pair in pairs:
        touched = [group for group in groups if group & set(pair)]
        groups = [group for group in groups if group not in touched]
        groups.append(set(pair).union(*touched))
    return groups


def _bracketed(address: str) -> str:
    return f"[{address}]" if ":" in address else address


def _place(host: str) -> str:
    return f"on `{host}`" if host else "on this machine"
