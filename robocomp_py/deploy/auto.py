"""The middleware of each link of a network, chosen by where its two ends run.

    in one process, on one host    the transport that is made for it (`transports.deployment.Near`)
    else                           the middleware that the provider is always reached by, also from elsewhere

This holds for ends that leave the choice open: they name no middleware, or `auto`. An end that
names one decides for the other end, too. The choices become settings of the instances: a provider
offers what its links need in addition to its own middleware, and each client gets one way to each
of its providers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import chain
from typing import Protocol

from ..contract.component import Port
from ..contract.interface import Pattern, Verb
from ..errors import ConfigurationError, TransportError
from ..runtime.effective import toml
from ..transports.base import TransportConfig, find_transport
from ..transports.deployment import Near, deployment_of, deployments
from ..transports.network import Fault
from ..transports.network import Way as Way
from ..wire import names
from .qos import lacking, unsupported_over
from .routes import Aim, ByChannel, Configured, met, unfit


class Usable(Protocol):
    def __call__(self, middleware: str, connections: int = 0, /) -> str:
        """Why a middleware cannot be used on this host by this many pairs of a client and a provider; "" if it can."""


@dataclass(frozen=True)
class Choice:
    """The ways of a network, and the settings that make them so."""

    ways: tuple[Way, ...] = ()
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By instance, `key=value`."""
    notes: tuple[str, ...] = ()
    """The better ways that could not be used, with the reasons, a line each."""

    @cached_property
    def carriers(self) -> Mapping[str, frozenset[str]]:
        """The middlewares of each instance that has links."""
        found: dict[str, set[str]] = {}
        for way in self.ways:
            for end in (way.client, way.provider):
                found.setdefault(end, set()).add(way.middleware)
        return {name: frozenset(middlewares) for name, middlewares in found.items()}


def installed_here(middleware: str, connections: int = 0) -> str:
    """Whether a middleware can be used, judged without opening it."""
    fault = unfit(middleware)
    return fault.message if fault else ""


def usable(middleware: str, connections: int = 0) -> str:
    """Whether a middleware can be used: it is opened, once, and closed again; and says what else it needs."""
    reason = can_be_opened(middleware)
    return deployment_of(middleware).crowded(connections) if connections and not reason else reason


@cache
def can_be_opened(middleware: str) -> str:
    """Why a middleware cannot be opened; "" if it can."""
    reason = installed_here(middleware)
    if reason:
        return reason
    try:
        find_transport(middleware)(TransportConfig(owner="rcdeploy")).close()
    except (TransportError, ConfigurationError, OSError) as exc:
        return str(exc)
    return ""


def choose(configured: Sequence[Configured], usable: Usable = installed_here) -> Choice:
    """The best ways between instances. What is wrong with their wiring is not our business: see `check_routes`."""
    links = list(_links(configured))
    chooser = _chosen(links, usable)
    for middleware in _nearest(Near.HOST):
        if (met := chooser.connections(middleware)) and (reason := usable(middleware, met)):
            usable = _without(middleware, reason, usable)
            chooser = _chosen(links, usable)
    settings: dict[str, tuple[str, ...]] = {}
    for each in configured:
        if not each.is_program:
            settings[each.runs_as] = (*settings.get(each.runs_as, ()), *chooser.settings(each))
    ways = tuple(replace(each.way, looked_up=chooser.looked_up(each)) for each in chooser.links)
    return Choice(ways, {name: assignments for name, assignments in settings.items() if assignments}, chooser.notes())


def _chosen(links: Sequence[_Link], usable: Usable) -> _Chooser:
    chooser = _Chooser(usable)
    for link in links:
        chooser.link(link)
    return chooser


def _nearest(near: Near) -> list[str]:
    """The transports that are made for instances that are so close to each other."""
    return [name for name, each in deployments().items() if each.near is near]


def _without(middleware: str, reason: str, usable: Usable) -> Usable:
    return lambda name, connections=0: reason if name == middleware else usable(name, connections)


def unsupported_by_others(configured: Sequence[Configured]) -> Iterator[Fault]:
    """A fault for each port whose QoS is not offered by the middleware that the other end names for both."""
    for link in _links(configured):
        middleware, origin = link.named()
        for end, port in ((link.client, link.port), (link.server, link.theirs)):
            if not end.named(port, link.operation):
                yield from unsupported_over(middleware, origin, end, port, link.operation, link.pattern)


def _links(configured: Sequence[Configured]) -> Iterator[_Link]:
    """What each instance uses of the others."""
    by_channel = ByChannel(configured)
    for client in configured:
        for port, operation, pattern in client.patterns(providing=False):
            for aim, server, theirs in met(client, port, operation, by_channel):
                if not (client.is_program and server.is_program):  # their use is unknown here
                    yield _Link(client, port, aim, operation, pattern, server, theirs)


@dataclass(frozen=True)
class _Link:
    client: Configured
    port: Port
    aim: Aim
    operation: str
    pattern: Pattern
    server: Configured
    theirs: Port

    def named(self) -> tuple[str, str]:
        """The middleware that an end names, and where; "" if both leave it open."""
        if name := self.aim.middleware:
            return name, f"{self.client.name}: {self.client.aim_origin(self.port, self.operation, self.aim)}"
        if name := self.server.named(self.theirs, self.operation):
            return name, f"{self.server.name}: {self.server.origin(self.theirs, self.operation)}"
        return "", ""

    def spoken(self) -> str:
        """What a program at one end speaks: what its component was generated for, or else the other end; "" if none."""
        ends = [(self.client, self.port), (self.server, self.theirs)]
        if not any(end.is_program for end, _ in ends):
            return ""
        ends.sort(key=lambda each: not each[0].is_program)
        return next((name for end, port in ends if (name := end.middleware(port, self.operation))), "")

    def lacks(self, middleware: str) -> str:
        """What a middleware does not offer of the QoS of either end."""
        ends = (self.client, self.port), (self.server, self.theirs)
        missing = [lacking(middleware, self.pattern, end.qos(port, self.operation)) for end, port in ends]
        return ", ".join(dict.fromkeys(chain(*missing)))

    @property
    def channel(self) -> str:
        """Its name on the wire."""
        segment = self.server.component.segment(self.theirs)
        return "/".join((self.server.channels, segment, self.operation))

    @property
    def source(self) -> str:
        """The `from` by which the client names exactly this provider."""
        segment = self.server.component.segment(self.theirs)
        own = self.client.settings.namespace, self.port.interface.short
        return names.target(self.server.settings.namespace, self.server.instance, segment, *own)


@dataclass(frozen=True)
class _Chosen:
    link: _Link
    way: Way


_End = tuple[str, Verb, str, str]


def _end(instance: Configured, port: Port, operation: str) -> _End:
    return instance.name, port.verb, port.label, operation


class _Chooser:
    def __init__(self, usable: Usable) -> None:
        self._usable = usable
        self._nearest = {near: _nearest(near) for near in Near}
        self.links: list[_Chosen] = []
        self._by_end: dict[_End, list[_Chosen]] = {}
        self._instead: Counter[tuple[str, str, str]] = Counter()
        """How many links go by something else than the middleware that is named first, and why."""

    def link(self, link: _Link) -> None:
        middleware, origin = link.named()
        middleware, why = (middleware, f"named ({origin})") if middleware else self._best(link)
        names = link.client.name, link.port.label, link.server.runs_as, link.port.verb, link.port.interface.short
        named = link.server.instance if link.server.owner else ""
        way = Way(*names, link.operation, middleware, why, link.channel, origin=origin, named=named)
        chosen = _Chosen(link, replace(way, parts=_parts(link.port, link.operation)))
        self.links.append(chosen)
        for end in (_end(link.client, link.port, link.operation), _end(link.server, link.theirs, link.operation)):
            self._by_end.setdefault(end, []).append(chosen)

    def _best(self, link: _Link) -> tuple[str, str]:
        if spoken := link.spoken():
            return spoken, "a program of your own"
        network = link.server.middleware(link.theirs, link.operation)
        hindered: list[tuple[str, str]] = []
        ends = link.client, link.server
        here = {Near.PROCESS: ends[0].is_with(ends[1]), Near.HOST: ends[0].host == ends[1].host}
        for better, why in ((name, str(near)) for near in Near if here[near] for name in self._nearest[near]):
            hindrance = self._hindrance(better, link)
            if not hindrance:
                self._instead.update((which, reason, better) for which, reason in hindered)
                return better, why
            hindered.append((better, hindrance))
        self._instead.update((which, reason, network) for which, reason in hindered)
        apart = "two hosts" if link.client.host != link.server.host else ""
        return network, "; ".join(f"no {which}: {reason}" for which, reason in hindered) or apart

    def _hindrance(self, middleware: str, link: _Link) -> str:
        if reason := self._usable(middleware):
            return reason.removeprefix(f"{middleware}: ")
        missing = link.lacks(middleware)
        return f"it does not offer {missing}" if missing else ""

    def connections(self, middleware: str) -> int:
        """Pairs of a client and a provider of this host that a middleware was chosen for, by us or by the network."""
        ways = (each.way for each in self.links if not each.link.client.host)
        return len({(way.client, way.provider) for way in ways if way.middleware == middleware})

    def notes(self) -> tuple[str, ...]:
        return tuple(
            f"{which} is not used for {count} {'operation' if count == 1 else 'operations'}, which "
            f"{'goes' if count == 1 else 'go'} over {instead or 'what was generated for'} instead: {reason}"
            for (which, reason, instead), count in self._instead.items()
        )

    # Settings.

    def settings(self, each: Configured) -> Iterator[str]:
        """What makes the ways of an instance what they are, port by port, or operation by operation."""
        for port in each.component.ports:
            find = self._offered if port.verb.provides else self._used
            wanted = {name: find(each, port, name) for name in port.interface.called(port.verb)}
            apart = any((port.name, name) in each.settings.ports for name in wanted)  # which counts more than the port
            if len(set(wanted.values())) == 1 and not apart:
                wanted = {"": next(iter(wanted.values()))}
            for operation, keys in wanted.items():
                at = ".".join(filter(None, (*each.tables, port.name, operation)))
                yield from (f"{at}.{key}" for key in keys)

    def _offered(self, server: Configured, port: Port, operation: str) -> tuple[str, ...]:
        """What a provider needs beside what it offers anyway."""
        chosen = self._by_end.get(_end(server, port, operation), ())
        if server.named(port, operation):
            chosen = [each for each in chosen if each.link.aim.is_link]
        always, *own = server.settings.middlewares(port, operation, server.generated_for)
        used = {each.way.middleware for each in chosen}
        if used <= {always, *own, ""}:
            return ()
        nearest = [each for near in Near for each in self._nearest[near]]
        also = sorted({*own, *used} - {always, ""}, key=lambda name: (*(name != each for each in nearest), name))
        return (f"also={toml(also)}",)

    def _used(self, client: Configured, port: Port, operation: str) -> tuple[str, ...]:
        """The ways of a client to its providers, if they are not what they are anyway."""
        aims = client.aims(port, operation)
        carriers = client.settings.middlewares(port, operation, client.generated_for)
        before = [(aim.source, name) for aim, name in zip(aims, carriers, strict=True)]
        ways = [
            way for given in zip(aims, carriers, strict=True) for way in self._apart(client, port, operation, *given)
        ]
        if ways == before:
            return ()
        (source, middleware), *others = ways
        found = [] if aims[0].middleware == middleware else [f"middleware={middleware}"]
        found += [f"from={source}"] if source != aims[0].source else []
        also = [{"from": source, "middleware": name} for source, name in others]
        return (*found, f"also={toml(also)}") if also else tuple(found)

    def _apart(
        self, client: Configured, port: Port, operation: str, aim: Aim, carrier: str
    ) -> Iterator[tuple[str, str]]:
        """One aim of a client as `from` and middleware; several if its providers are reached in several ways."""
        links = [each for each in self._by_end.get(_end(client, port, operation), ()) if each.link.aim == aim]
        used = {each.way.middleware for each in links}
        if self._goes_apart(links):
            yield from ((each.link.source, each.way.middleware) for each in links)
        elif aim.middleware or len(used) != 1:
            yield aim.source, carrier  # with several servers it is unknown which is meant
        else:
            yield aim.source, used.pop()

    @staticmethod
    def _goes_apart(links: Sequence[_Chosen]) -> bool:
        """Whether a subscription is made once for each publisher, as their messages come in different ways."""
        several = len({each.way.middleware for each in links}) > 1
        return several and not any(each.link.aim.middleware or each.way.verb is Verb.REQUIRES for each in links)

    def looked_up(self, chosen: _Chosen) -> str:
        """The channel's name as the client looks for it, by the settings of `_apart`."""
        link = chosen.link
        beside = [
            each
            for each in self._by_end[_end(link.client, link.port, link.operation)]
            if each.link.aim == link.aim and each.link.client is link.client
        ]
        if self._goes_apart(beside):
            return link.channel
        return names.channel(*link.client.source(link.port, link.aim), link.operation)


def _parts(port: Port, name: str) -> tuple[tuple[str, Verb], ...]:
    """What the channels of an action have behind its name, and what a client does with each; none for operations."""
    found = [each for each in port.interface.actions_under(port.verb) if each.name == name]
    return tuple(
        (part.name.removeprefix(name), Verb.SUBSCRIBES if part.pattern is Pattern.PUBLISH else Verb.REQUIRES)
        for action in found
        for part in action.parts
    )
