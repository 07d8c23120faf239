"""Computes the addresses at which the instances of a network find each other over Ice. No I/O here.

Instances of one host find each other by themselves. In the other cases an object has a known host and port:

- a program that is not configured by `rcdeploy` is where its own `config` says, or at the `port` of its instance
- an interface that another host or such a program uses is where the configuration of its instance says, or at the
  `port` of that instance, or where the program expects it; else, for another host, at a port that follows from the
  network's name
- several interfaces of an instance are at its `port`, the next one, and so on, in the order of its CDSL; those of a
  named instance at the `port` of that

Each client gets these places in `transports.ice.proxies`, unless its own configuration names them. Likewise
`transports.ice.topics` gets the names by which programs call topics.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...wire import names
from .. import iceoptions
from ..iceoptions import IceOptions
from ..network import LOOPBACK, Fault, Helper, Network, Placement, Site, Way


def find(network: Network) -> Placement:
    """How the ways over Ice are found."""
    return _Finder(network).found()


@dataclass(frozen=True)
class _Object:
    """An interface of an instance."""

    instance: str
    segment: str
    """In channels; of a named instance with its name in front: `front/Laser`."""

    @property
    def named(self) -> str:
        """The named instance; "" if the instance provides it by its own name."""
        return self.segment.rpartition("/")[0]

    @property
    def interface(self) -> str:
        """Without the named instance."""
        return self.segment.rpartition("/")[2]

    @property
    def key(self) -> str:
        """In the keys of settings."""
        return f'"{self.segment}"' if self.named else self.segment


class _Finder:
    def __init__(self, network: Network) -> None:
        self._network, self._everyone = network, network.by_name
        self._calls = [way for way in network.ways if not way.verb.is_topic]
        self._topics = [way for way in network.ways if way.verb.is_topic]
        self._free, self._here = iter(network.free_ports), network.addresses.get("", LOOPBACK)
        self._options = {each.instance: _options(each, network.middleware) for each in network.sites}
        self._at: dict[_Object, tuple[str, int]] = {}
        """Host, "" if it is that of the instance, and port of what is known to be somewhere."""
        self._listening: list[str] = []
        """Those that are reached from other hosts."""
        self._set_for: dict[str, list[tuple[str, Any]]] = {}
        self._taken: dict[str, int] = {}
        self._faults: list[Fault] = []
        self._helpers: list[Helper] = []
        self._storms: Mapping[str, str] = {}
        """By instance that is not a program: the proxy of its IceStorm."""

    def found(self) -> Placement:
        for each in self._everyone.values():
            self._place(each)
        for way in self._calls:
            self._place_as_expected(way)
        for way in {_object(way): way for way in self._calls if self._crosses(way)}.values():
            self._place_anywhere(way)
        self._check_ports()
        self._listen()
        told: dict[str, dict[str, str]] = {}
        for way in {(way.client, way.channel.rpartition("/")[0]): way for way in self._calls}.values():
            for key, proxy in self._proxy(way):
                told.setdefault(way.client, {})[key] = proxy
        for client, proxies in told.items():
            self._set(client, "proxies", {**self._options[client].proxies, **proxies})
        self._find_storms()
        programs, publishers = dict(self._programs()), dict(self._publishers())
        return Placement(self._set_for, self._taken, self._faults, self._helpers, programs, publishers)

    # Where things are.

    def _place(self, each: Site) -> None:
        """Note the places that the configuration of an instance names; its `port` counts for the other interfaces."""
        objects = [_Object(each.instance, segment) for segment in self._served(each)]
        for served in objects:
            if said := self._options[each.instance].endpoints.get(served.segment):
                endpoint = iceoptions.parse_endpoints(said)[0]
                if endpoint.port:
                    self._at[served] = endpoint.host, endpoint.port
        by_name: dict[str, list[_Object]] = {}
        for served in objects:
            by_name.setdefault(served.named, []).append(served)
        for named, those in by_name.items():
            first = each.ports.get(named, 0) if named else each.port
            if first and not named:
                self._taken[each.instance] = len(those)
            for number, served in enumerate(those if first else ()):
                if served in self._at:
                    continue
                if not each.is_program:
                    self._serve(served, first + number)
                elif len(those) == 1:
                    self._at[served] = "", first

    def _served(self, each: Site) -> Sequence[str]:
        """The interfaces that it is called by over Ice."""
        return each.interfaces.get(self._network.middleware, ())

    def _place_as_expected(self, way: Way) -> None:
        """Serve an interface where a program expects it."""
        client, served = self._everyone[way.client], _object(way)
        if not client.is_program:
            return
        said = self._options[client.instance].proxies.get(way.port)
        if said:
            expected = iceoptions.parse_proxy(said).endpoints[0].port
            if served not in self._at:
                self._serve(served, expected)
            elif (at := self._at[served][1]) != expected:
                message = f"`{way.client}` expects `{way.interface}` at port {expected}, but `{way.provider}` has {at}"
                self._fault(way, message, "change the configuration of one of them")
        elif served not in self._at:
            message = f"`{way.client}` uses `{way.interface}` of `{way.provider}`, whose port is unknown"
            self._fault(way, message, f"give `{way.provider}` the port that the program asks: port 10003;")

    def _place_anywhere(self, way: Way) -> None:
        """Serve an interface that another host uses at a port of the network, if it has no place yet."""
        port, served = next(self._free, 0), _object(way)
        if served in self._at or self._everyone[served.instance].is_program:
            return
        if port:
            self._serve(served, port)
        else:
            message = f"`{way.provider}` needs a port for `{way.interface}` over Ice, but the network has no port left"
            self._fault(way, message, f"give `{way.provider}` one of its own: port 10003;")

    def _serve(self, served: _Object, port: int) -> None:
        self._at[served] = "", port
        self._set(served.instance, f"endpoints.{served.key}", f"tcp -p {port}")

    def _check_ports(self) -> None:
        """Of two instances on one host, only one can listen at a port."""
        first: dict[tuple[str, int], _Object] = {}
        for served, (_, port) in self._at.items():
            other = first.setdefault((self._everyone[served.instance].host, port), served)
            if other.instance != served.instance:
                both = f"`{other.instance}` and `{served.instance}`"
                message = f"port {port} over Ice is given to both `{other.segment}` and `{served.segment}`, of {both}"
                hint = "change one of them; the interfaces of an instance have consecutive ports"
                fault = Fault("port-clash", message, hint, served.instance, (both, str(port)), other.instance)
                self._faults.append(fault)

    def _listen(self) -> None:
        """Have instances with peers on another host listen at the address of their own host."""
        crossing = filter(self._crosses, (*self._calls, *self._topics))
        for name in dict.fromkeys(end for way in crossing for end in (way.client, way.provider)):
            if self._options[name].host == iceoptions.HOST:
                self._listening.append(name)
                self._set(name, "host", self._address(name))

    def _proxy(self, way: Way) -> Iterator[tuple[str, str]]:
        """The proxy that a client needs for an interface, and the key of that option."""
        client, provider, served = self._everyone[way.client], self._everyone[way.provider], _object(way)
        if client.is_program or (not provider.is_program and not self._crosses(way)):
            return
        options = self._options[client.instance]
        if options.proxy_of(way.channel):
            return
        key, segment = iceoptions.key_of(way.channel), names.segment(way.channel)
        if served in self._at:
            host, port = self._at[served]
            there = self._address(way.provider) if self._crosses(way) else LOOPBACK
            yield key, _proxy_at(segment, host or there, port)
        elif own := _old_proxy(client, way.port):
            yield key, own
        else:
            message = (
                f"the port at which the program `{way.provider}` serves `{way.interface}` for `{way.client}` is unknown"
            )
            by_port, by_file = "add its port: port 10003;", 'name its own configuration: config "etc/config";'
            self._fault(way, message, by_file if len(self._served(provider)) > 1 else by_port)

    def _programs(self) -> Iterator[tuple[tuple[str, str], str]]:
        """Where foreign programs serve their interfaces, for those on the machine that launches the network."""
        for served, (host, port) in self._at.items():
            site = self._everyone[served.instance]
            if site.is_program:
                there = host or (self._network.address(site) if site.host else LOOPBACK)
                yield (served.instance, served.segment), _proxy_at(served.interface, there, port)

    # IceStorm.

    def _find_storms(self) -> None:
        """Find the IceStorm of each publisher and subscriber, also of those whose peers are outside of the network."""
        users = dict.fromkeys(end for way in self._topics for end in (way.client, way.provider))
        users |= dict.fromkeys(each.instance for each in self._network.sites if self._network.middleware in each.topics)
        own = [name for name in users if not self._everyone[name].is_program]
        abroad = any(self._everyone[name].host for name in users)
        self._storms = storms = {name: self._storm_of(name, abroad=abroad) for name in own}
        for number, storm in enumerate(dict.fromkeys(storms.values())):
            self._helpers.append(icestorm(storm, number, "" if LOOPBACK in storm else None))
        self._name_topics()
        said = {name: self._options[name].storm for name in users if name not in storms}
        known = storms | {name: storm for name, storm in said.items() if storm != iceoptions.STORM}
        for way in self._topics:
            if way.client in known and way.provider in known:
                self._check_topic(way, known)

    def _storm_of(self, name: str, *, abroad: bool) -> str:
        """The proxy of the IceStorm that an instance uses. It is set if the instance would look at its own address."""
        storm, host = self._options[name].storm, self._options[name].host
        if any(each.host for each in iceoptions.parse_proxy(storm).endpoints):
            return storm
        if host != iceoptions.HOST:
            return _at_host(storm, host)
        storm = _at_host(storm, self._here if abroad else LOOPBACK)
        if abroad or name in self._listening:
            self._set(name, "storm", storm)
        return storm

    def _publishers(self) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """Where the topics of foreign programs are heard, for those on the machine that launches the network.

        A program that does not say where its IceStorm is has that of its peers, or else one on its own host.
        """
        for site in self._network.sites:
            if not site.is_program or self._network.middleware not in site.topics:
                continue
            options = self._options[site.instance]
            storm = options.storm
            if storm == iceoptions.STORM:
                peers = {way.client for way in self._topics if way.provider == site.instance}
                peers |= {way.provider for way in self._topics if way.client == site.instance}
                storm = next((each for name, each in self._storms.items() if name in peers), storm)
            if not any(each.host for each in iceoptions.parse_proxy(storm).endpoints):
                there = self._network.address(site) if site.host else LOOPBACK
                storm = _at_host(storm, there if options.host == iceoptions.HOST else options.host)
            host = iceoptions.HOST if LOOPBACK in storm else self._here  # IceStorm calls those that hear
            yield site.instance, {"storm": storm, "host": host, "topics": dict(options.topics)}

    def _name_topics(self) -> None:
        """Give instances the names that programs have for their topics, from a configuration or an interface."""
        by_programs: dict[str, str] = {}
        for way in self._topics:
            for end in (way.provider, way.client):
                if self._everyone[end].is_program:
                    name = self._options[end].topics.get(way.interface, way.interface)
                    by_programs.setdefault(iceoptions.key_of(way.channel), name)
        told: dict[str, dict[str, str]] = {}
        for way in self._topics:
            name = by_programs.get(iceoptions.key_of(way.channel), "")
            for end in (way.provider, way.client):
                options = self._options[end]
                if name and not self._everyone[end].is_program and not options.topic_said_of(way.channel):
                    told.setdefault(end, {})[iceoptions.key_of(way.channel)] = name
        for end, topics in told.items():
            options = self._options[end]
            self._options[end] = replace(options, topics={**options.topics, **topics})
            if any(self._options[end].topic_of(way.channel) != options.topic_of(way.channel) for way in self._topics):
                self._set(end, "topics", self._options[end].topics)

    def _check_topic(self, way: Way, storms: Mapping[str, str]) -> None:
        """Refuse a publisher and a subscriber that use different topics or different IceStorms."""
        client, provider = storms[way.client], storms[way.provider]
        heard, told = (self._options[end].topic_of(way.channel) for end in (way.client, way.provider))
        if not any(_is_one(a, b) for a in _corners(client) for b in _corners(provider)):
            message = (
                f"`{way.client}` subscribes to `{way.interface}` through the IceStorm at `{client}`, "
                f"but `{way.provider}` publishes it through the one at `{provider}`"
            )
            hint = "give both the same transports.ice.storm"
        elif heard != told and not any(self._everyone[end].is_program for end in (way.client, way.provider)):
            message = (
                f"`{way.client}` subscribes to `{way.interface}` by the topic `{heard}` of IceStorm, "
                f"but `{way.provider}` publishes it as `{told}`"
            )
            hint = "let transports.ice.topics say the same for both"
        else:
            return
        subject = way.client, way.provider, way.interface
        fault = Fault("middleware-mismatch", message, hint, way.client, subject, way.provider, way.port)
        self._faults.append(fault)

    # What all need.

    def _address(self, instance: str) -> str:
        return self._network.address(self._everyone[instance])

    def _crosses(self, way: Way) -> bool:
        return self._everyone[way.client].host != self._everyone[way.provider].host

    def _set(self, instance: str, key: str, value: Any) -> None:
        if not self._everyone[instance].is_program:
            self._set_for.setdefault(instance, []).append((key, value))

    def _fault(self, way: Way, message: str, hint: str) -> None:
        subject = way.client, way.provider, way.interface
        self._faults.append(Fault("no-address", message, hint, way.client, subject, way.provider, way.port))


def _object(way: Way) -> _Object:
    return _Object(way.provider, names.within(way.named, names.segment(way.channel)))


def _options(each: Site, middleware: str) -> IceOptions:
    """Of an instance whose configuration has been checked."""
    return iceoptions.read(each.options.get(middleware, {}))


def _old_proxy(client: Site, port: str) -> str:
    """The proxy that a configuration in another form names for a port; "" if it names none."""
    found = client.peers.get(port.lower(), "")
    with contextlib.suppress(ValueError):
        return found if found and iceoptions.parse_proxy(found) else ""
    return ""


def _at_host(proxy: str, host: str) -> str:
    """A proxy whose endpoints name no host, at one."""
    name, *endpoints = proxy.split(":")  # where no host is named, no colon is quoted
    words = (each.split(maxsplit=1) for each in endpoints)
    return ":".join((name, *(" ".join((protocol, "-h", _quoted(host), *rest)) for protocol, *rest in words)))


def _corners(proxy: str) -> set[tuple[str, str, int]]:
    """The places of the objects of a proxy, in one form."""
    found = iceoptions.parse_proxy(proxy)
    return {(found.identity, _number(each.host), each.port) for each in found.endpoints}


def _is_one(corner: tuple[str, str, int], other: tuple[str, str, int]) -> bool:
    """Whether two places may be the same; a place without a host may be on any."""
    return corner == other or (corner[0] == other[0] and corner[2] == other[2] and "" in (corner[1], other[1]))


def _number(host: str) -> str:
    return LOOPBACK if host.lower() in ("localhost", "::1") else host.lower()


def _proxy_at(interface: str, host: str, port: int) -> str:
    return f"{interface.lower()}:tcp -h {_quoted(host)} -p {port}"


def _quoted(host: str) -> str:
    return f'"{host}"' if ":" in host else host


def icestorm(proxy: str, number: int = 0, host: str | None = None) -> Helper:
    """The IceStorm at a TopicManager's proxy; without a host, the one that has its address runs it."""
    note = f"{proxy}, run with the network if that is here and none answers there"
    return Helper("ice", host, {"storm": proxy}, f"ice-storm{number or ''}", "IceStorm", note=note)
