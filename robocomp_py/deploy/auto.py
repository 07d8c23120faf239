"""The best way for each link of a network, by where its two ends are.

    in one process      `inproc`: objects, no bytes
    on one host         `shm`: shared memory
    else                the middleware that the provider is always reached by, also from outside of the network

This holds for ends that leave the choice open (nobody named a middleware for them, or `auto`). An
end that names one decides for the other, too. What is chosen becomes settings of the instances: a
provider offers what its links need beside what it offers anyway, and who uses it gets one way to
each provider.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import chain

from ..contract.component import Port
from ..contract.interface import Pattern, Verb
from ..errors import ConfigurationError, TransportError
from ..runtime.effective import toml
from ..transports.base import TransportConfig, find_transport
from ..wire import names
from .qos import lacking, unsupported_over
from .routes import Aim, Configured, Everybody, Fault, met, unfit

INPROC, SHM = "inproc", "shm"

Usable = Callable[[str], str]
"""Why a middleware cannot be used on this host; "" if it can."""


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


@dataclass(frozen=True)
class Choice:
    """The ways of a network, and the settings that make them so."""

    ways: tuple[Way, ...] = ()
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By instance, `key=value`."""
    notes: tuple[str, ...] = ()
    """Which better ways could not be taken, and why: a line each."""

    @cached_property
    def carriers(self) -> Mapping[str, frozenset[str]]:
        """What carries the messages of each instance that has any ways."""
        found: dict[str, set[str]] = {}
        for way in self.ways:
            for end in (way.client, way.provider):
                found.setdefault(end, set()).add(way.middleware)
        return {name: frozenset(middlewares) for name, middlewares in found.items()}


def installed_here(middleware: str) -> str:
    """Whether a middleware can be used, as far as can be told without opening it."""
    fault = unfit(middleware)
    return fault.message if fault else ""


@cache
def usable(middleware: str) -> str:
    """Whether a middleware can be used: it is opened, once, and closed again."""
    reason = installed_here(middleware)
    if reason or middleware == INPROC:
        return reason
    try:
        find_transport(middleware)(TransportConfig(owner="rcdeploy")).close()
    except (TransportError, ConfigurationError, OSError) as exc:
        return str(exc)
    return ""


def choose(configured: Sequence[Configured], usable: Usable = installed_here) -> Choice:
    """The best ways between instances. What is wrong with their wiring is not our business: see `check_routes`."""
    chooser = _Chooser(usable)
    for link in _links(configured):
        chooser.link(link)
    settings = {each.name: tuple(chooser.settings(each)) for each in configured if not each.is_program}
    ways = tuple(each.way for each in chooser.links)
    return Choice(ways, {name: assignments for name, assignments in settings.items() if assignments}, chooser.notes())


def unsupported_by_others(configured: Sequence[Configured]) -> Iterator[Fault]:
    """A fault for each port whose QoS is not offered by the middleware that the other end names for both."""
    for link in _links(configured):
        middleware, origin = link.named()
        for end, port in ((link.client, link.port), (link.server, link.theirs)):
            if not end.named(port, link.operation):
                yield from unsupported_over(middleware, origin, end, port, link.operation, link.pattern)


def _links(configured: Sequence[Configured]) -> Iterator[_Link]:
    """What instances use of others."""
    everybody = Everybody(configured)
    for client in configured:
        for port, operation, pattern in client.patterns(providing=False):
            for aim, server, theirs in met(client, port, operation, everybody):
                if not (client.is_program and server.is_program):  # what those do is theirs to know
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
        """The `from` by which the client means this provider and nobody else."""
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
        self.links: list[_Chosen] = []
        self._by_end: dict[_End, list[_Chosen]] = {}
        self._instead: Counter[tuple[str, str, str]] = Counter()
        """How many links go by something else than the middleware that is named first, and why."""

    def link(self, link: _Link) -> None:
        middleware, why = self._best(link)
        names = link.client.name, link.port.label, link.server.name, link.port.verb, link.port.interface.short
        chosen = _Chosen(link, Way(*names, link.operation, middleware, why, link.channel))
        self.links.append(chosen)
        for end in (_end(link.client, link.port, link.operation), _end(link.server, link.theirs, link.operation)):
            self._by_end.setdefault(end, []).append(chosen)

    def _best(self, link: _Link) -> tuple[str, str]:
        middleware, origin = link.named()
        if middleware:
            return middleware, f"named ({origin})"
        if spoken := link.spoken():
            return spoken, "a program of your own"
        network = link.server.middleware(link.theirs, link.operation)
        hindered: list[tuple[str, str]] = []
        for better, here, why in (
            (INPROC, link.client.is_with(link.server), "one process"),
            (SHM, link.client.host == link.server.host, "one host"),
        ):
            if not here:
                continue
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
            wanted = {
                operation.name: self._offered(each, port, operation.name)
                if port.verb.provides
                else self._used(each, port, operation.name)
                for operation, _ in port.interface.under(port.verb)
            }
            apart = any((port.name, name) in each.settings.ports for name in wanted)  # which counts more than the port
            if len(set(wanted.values())) == 1 and not apart:
                wanted = {"": next(iter(wanted.values()))}
            for operation, keys in wanted.items():
                at = f"ports.{port.name}.{operation}" if operation else f"ports.{port.name}"
                yield from (f"{at}.{key}" for key in keys)

    def _offered(self, server: Configured, port: Port, operation: str) -> tuple[str, ...]:
        """What a provider needs beside what it offers anyway."""
        if server.named(port, operation):
            return ()
        always, *own = server.settings.middlewares(port, operation, server.generated_for)
        used = {each.way.middleware for each in self._by_end.get(_end(server, port, operation), ())}
        if used <= {always, *own, ""}:
            return ()
        also = sorted({*own, *used} - {always, ""}, key=lambda name: (name != INPROC, name != SHM, name))
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
        if aim.middleware or not used:
            yield aim.source, carrier
        elif len(used) == 1:
            yield aim.source, used.pop()
        elif port.verb is Verb.REQUIRES:
            yield aim.source, carrier  # of several providers nobody knows which is meant
        else:
            yield from ((each.link.source, each.way.middleware) for each in links)
