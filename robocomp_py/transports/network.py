"""A network as the deployment side of a transport sees it: the places and uses of instances. Values only.

Ports follow from the network's name and the order of its instances. So a restarted instance is found where it was, and
a firewall can be told.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, Any

from ..contract.middleware import DEFAULT

if TYPE_CHECKING:
    from ..contract.interface import Verb

LOOPBACK = "127.0.0.1"

FIRST_PORT, BLOCK, BLOCKS = 20000, 100, 100
"""Each network has a block of ports, below those that systems give away: for helpers, then one for each instance."""

FURTHER_PORT, FURTHER, FURTHER_BLOCKS = 12000, 1000, 8
"""From the 100th instance on, ports are in a larger block, which never overlaps another network's first block."""

PORTS = BLOCK + FURTHER
"""A network has no more ports than these."""


@dataclass(frozen=True)
class Way:
    """What carries one operation between two instances."""

    client: str
    port: str
    """As the CDSL of the client has it."""
    provider: str
    verb: Verb
    interface: str
    operation: str
    middleware: str
    why: str
    channel: str = ""
    """Its name on the wire."""
    looked_up: str = ""
    """The name that the client looks for: that of the channel, or one with `*` where any instance will do."""
    origin: str = ""
    """Which instance names the middleware, and where it does; "" if rcdeploy chose it."""
    named: str = ""
    """The named instance of the provider, in its system; "" if the provider offers it by its own name."""
    parts: tuple[tuple[str, Verb], ...] = ()
    """Of an action: what its channels have behind its name, each with what the client does with it."""

    @property
    def source(self) -> str:
        """What is used, for people: `world`, or `world/front` for a named instance."""
        return f"{self.provider}/{self.named}" if self.named else self.provider


@dataclass(frozen=True)
class Site:
    """An instance, and where it runs."""

    instance: str
    process: str
    host: str = ""
    """"" is the machine that launches the network."""
    port: int = 0
    """At which it is to be reached; 0 if the network does not say."""
    is_program: bool = False
    """Whether it is a program of its own, which is not configured by `rcdeploy`."""
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Of each transport, as the instance is configured."""
    interfaces: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Of each transport whose interfaces have ports of their own: those that are called over it, in their order."""
    topics: frozenset[str] = frozenset()
    """Those of these transports over which the instance publishes or subscribes."""
    ports: Mapping[str, int] = field(default_factory=dict)
    """Those that the network gives to named instances, by the named instance."""
    peers: Mapping[str, str] = field(default_factory=dict)
    """What a configuration in another form says about the ports of the instance."""


@dataclass(frozen=True)
class Helper:
    """A program that a transport needs on a host: there `rcdeploy` runs the `host` of its factory, with `options`."""

    middleware: str
    host: str | None
    """"" is the machine that launches the network; None is the one that has the address in the options."""
    options: Mapping[str, Any]
    name: str
    """With a dash in it, as no instance is called."""
    title: str
    """What it is, for people."""
    addresses: tuple[str, ...] = ()
    """Where it is reached, if it has a certificate in networks with keys."""
    note: str = ""
    """A line about it in the overview of a network; "" if it has none."""
    keys: str = ""
    """The folder of its keys, if it was given any."""


@dataclass(frozen=True)
class Fault:
    """An error, in the terms of a diagnostic. `instance` is the one that causes it; "" if no instance does."""

    code: str
    message: str
    hint: str = ""
    instance: str = ""
    subject: tuple[str, ...] = ()
    """Of several faults with one subject, the first is worth telling."""
    other: str = ""
    """The instance at the other end, if it is to blame as well."""
    port: str = ""
    """Of the instance, if it is about one."""
    origin: str = ""
    """The source of the fault, if it is known."""
    reason: str = ""
    """The message without that."""

    def __str__(self) -> str:
        return f"{self.message}; {self.hint}" if self.hint else self.message


@dataclass(frozen=True)
class Refusal:
    """A way that a transport cannot go."""

    way: Way
    message: str
    hint: str
    code: str = "unfit-middleware"


@dataclass(frozen=True)
class Wiring:
    """What a transport needs in a network."""

    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """By instance."""
    helpers: tuple[Helper, ...] = ()
    refusals: tuple[Refusal, ...] = ()


@dataclass(frozen=True)
class Placement:
    """Where the interfaces of instances are, over a transport whose interfaces have ports of their own."""

    options: Mapping[str, Sequence[tuple[str, Any]]] = field(default_factory=dict)
    """By instance: keys, with dots in them, and values."""
    taken: Mapping[str, int] = field(default_factory=dict)
    """By instance, how many ports from its `port` on are those of its interfaces."""
    faults: Sequence[Fault] = ()
    helpers: Sequence[Helper] = ()
    programs: Mapping[tuple[str, str], str] = field(default_factory=dict)
    """Where foreign programs serve their interfaces, as far as that is known, for `Deployment.reaching`. Keys are an
    instance and an interface, as in `Site.interfaces`."""
    publishers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """By foreign program with topics: where these are heard, for `Deployment.hearing`."""


@dataclass(frozen=True)
class Network:
    """`ways` are those of one transport, once a network is `over` it."""

    name: str
    addresses: Mapping[str, str]
    """By host: at which number the others reach it."""
    sites: Sequence[Site]
    """In the order in which they start."""
    ways: Sequence[Way]
    encrypted: bool = False
    """Whether only members of the network may take part, by their keys."""
    middleware: str = ""
    default: str = DEFAULT
    """The middleware to recommend."""

    @cached_property
    def by_name(self) -> Mapping[str, Site]:
        return {site.instance: site for site in self.sites}

    @cached_property
    def _numbers(self) -> Mapping[str, int]:
        return {site.instance: number for number, site in enumerate(self.sites, 1)}

    @property
    def configured(self) -> Iterator[Site]:
        """The instances that `rcdeploy` configures."""
        return (site for site in self.sites if not site.is_program)

    def over(self, middleware: str) -> Network:
        ways = [way for way in self.ways if way.middleware == middleware and self._ends(way)]
        return replace(self, ways=ways, middleware=middleware)

    def crossing(self) -> list[Way]:
        """The ways between instances on different hosts."""
        return [way for way in self.ways if len({site.host for site in self._ends(way)}) > 1]

    def between(self, way: Way) -> str:
        """The ends of a way, and where they run, for messages."""
        return f"`{way.client}` ({self.place(way.client)}) and `{way.provider}` ({self.place(way.provider)})"

    def place(self, instance: str) -> str:
        return named(self.by_name[instance].host)

    def hosts(self, ways: Iterable[Way]) -> list[str]:
        """The hosts of the ends of ways, in the order of the network."""
        found = {site.host for way in ways for site in self._ends(way)}
        return [host for host in self.addresses if host in found]

    def address(self, site: Site) -> str:
        return self.addresses[site.host]

    def endpoint(self, host: str, port: int) -> str:
        """`10.0.0.1:20000`, or `[fd00::1]:20000`."""
        address = self.addresses[host]
        return f"[{address}]:{port}" if ":" in address else f"{address}:{port}"

    @property
    def free_ports(self) -> list[int]:
        """The ports of the network that are none of its helpers or its instances."""
        return free_ports(self.name, len(self.sites))

    @property
    def helper_port(self) -> int:
        """For a helper of each host."""
        return port_of(self.name, 0)

    def port(self, site: Site) -> int:
        """For an instance: what the network says, or else one that follows from its place in the order."""
        return site.port or port_of(self.name, self._numbers[site.instance])

    def without_port(self, sites: Iterable[Site]) -> list[Site]:
        """The instances for which the network has no port."""
        return [site for site in sites if not site.port and self._numbers[site.instance] >= PORTS]

    def _ends(self, way: Way) -> list[Site]:
        """Both, or none if one is not known."""
        known = self.by_name
        return [known[way.client], known[way.provider]] if {way.client, way.provider} <= known.keys() else []


def named(host: str) -> str:
    """Where something runs, for people."""
    return f"on `{host}`" if host else "on this machine"


def port_of(network: str, number: int) -> int:
    """A port of a network: 0 is that of helpers, then come its instances, and then their further ones."""
    first, *further = ports_of(network, number + 1)
    return first[number] if number < BLOCK else further[0][number - BLOCK]


def free_ports(network: str, instances: int) -> list[int]:
    """The ports of a network that are none of its helpers or its instances."""
    return list(chain(*ports_of(network, PORTS)))[1 + instances :]


def ports_of(network: str, count: int) -> tuple[range, ...]:
    """All ports of a network that needs this many, at most `PORTS`."""
    first = FIRST_PORT + block_of(network) * BLOCK
    if count <= BLOCK:
        return (range(first, first + BLOCK),)
    further = FURTHER_PORT + zlib.crc32(network.encode()) // BLOCKS % FURTHER_BLOCKS * FURTHER
    return range(first, first + BLOCK), range(further, further + FURTHER)


def block_of(network: str) -> int:
    """The number of the block of ports that a name gives a network."""
    return zlib.crc32(network.encode()) % BLOCKS
