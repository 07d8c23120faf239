"""The middlewares and peers that the operations of configured instances really use.

The middleware of an operation may be chosen in many places, from the generated code to the command
line, and so may the instance a port uses. This module finds the result of all of them together.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from .. import installed
from ..contract.component import Component, Port
from ..contract.interface import Pattern, Verb
from ..contract.middleware import AUTO, carrier, is_auto
from ..contract.qos import QoS, shortfalls
from ..dsl.diagnostics import did_you_mean
from ..errors import ConfigurationError
from ..runtime.settings import Document, Settings, Way
from ..spelling import unknown
from ..transports.base import Capability, find_transport
from ..transports.deployment import deployment_of
from ..transports.network import Fault
from ..transports.network import Way as Carried
from ..wire import names


@dataclass(frozen=True)
class Aim:
    """The provider that a port is configured to use; a subscription may have several."""

    source: str
    """`from`; "" is any instance."""
    middleware: str
    """The middleware for it; "" if that is left open."""
    said: str
    """The key of the port that says so."""
    is_link: bool = False
    """Whether the network names the middleware for this link; the provider then offers it too."""


@dataclass(frozen=True)
class Configured:
    """An instance as it will run."""

    name: str
    component: Component
    settings: Settings
    document: Document
    generated_for: str
    """The choice in its generic part: a middleware, or auto; "" if there is none."""
    process: str = ""
    """The one it shares with others; "" if it has one of its own."""
    is_program: bool = False
    """Whether it is a foreign program, which the network does not configure."""
    host: str = ""
    """Which host it runs on; "" for the one that launches the network."""
    carriers: Mapping[str, str] = field(default_factory=dict)
    """The middlewares that the network names for single links, by the name of the port that uses."""
    owner: str = ""
    """The instance that offers it, if it is a named instance."""

    @cached_property
    def parts(self) -> tuple[Configured, ...]:
        """The instance with what it provides by its own name, and each of its named instances."""
        if not self.component.named:
            return (self,)
        ports = tuple(port for port in self.component.ports if not port.each)
        own = replace(self, component=replace(self.component, ports=ports))
        return (own, *(self._named(name) for name in self.settings.offers or ()))

    def _named(self, name: str) -> Configured:
        ports = tuple(port for port in self.component.named if name in (self.settings.offered(port) or ()))
        return replace(
            self,
            name="/".join((*self.name.split("/")[:-1], name)),
            component=replace(self.component, ports=ports),
            settings=self.settings.of(name),
            owner=self.name,
        )

    @property
    def runs_as(self) -> str:
        """The instance of the network that it is, or is a part of."""
        return self.owner or self.name

    @property
    def tables(self) -> tuple[str, ...]:
        """The key of the settings of its ports: `ports`, or `offers.front` for a named instance."""
        return ("offers", self.instance) if self.owner else ("ports",)

    def place(self, *key: str) -> str:
        """Where something is set for one of its ports, for people."""
        own = (*self.tables, *key)
        is_own = self.document.overridden(own) or self.document.says(own)
        return self.document.place(own if is_own else ("ports", *key))

    @cached_property
    def instance(self) -> str:
        """What it is called in its namespace."""
        return self.name.rpartition("/")[2]

    @property
    def channels(self) -> str:
        """What its channels begin with."""
        return "/".join(filter(None, (self.settings.namespace, self.instance)))

    def middleware(self, port: Port, operation: str) -> str:
        """The middleware of an operation, unless `auto` finds a better one."""
        return carrier(self.settings.port(port, operation).middleware, self.generated_for)

    def named(self, port: Port, operation: str) -> str:
        """The middleware that is required for an operation; "" if that is left open."""
        return _named(self.settings.port(port, operation).middleware or self.generated_for)

    def aims(self, port: Port, operation: str) -> list[Aim]:
        """The providers that a port is configured to use."""
        chosen = self.settings.port(port, operation)
        named = self.named(port, operation)
        own = Aim(chosen.source or "", named, "from", bool(named) and named == self.carriers.get(port.name))
        return [own, *(_further(own, way) for way in chosen.also or ())]

    def middlewares(self) -> set[str]:
        """All middlewares that it will open, including that of its own `CommonBehavior`."""
        ways = {
            way
            for part in self.parts
            for port, operation, _ in part.patterns()
            for way in part.settings.middlewares(port, operation, self.generated_for)
        }
        return (ways | {carrier(self.settings.middleware, self.generated_for)}) - {""}

    def is_with(self, other: Configured) -> bool:
        """Whether both run in one process."""
        shared = bool(self.process and (self.process, self.host) == (other.process, other.host))
        return shared or self.runs_as == other.runs_as

    def origin(self, port: Port, operation: str) -> str:
        """Where that middleware was chosen, for people."""
        for key in ((port.name, operation), (port.name,)):
            chosen = self.settings.ports.get(key)
            if chosen and chosen.middleware:
                return self.place(*key, "middleware")
        if port.middleware:
            return "its model"
        return self.document.place(("middleware",)) if self.settings.middleware else "generated for it"

    def qos(self, port: Port, operation: str) -> QoS:
        return self.settings.port(port, operation).qos or port.qos

    def qos_origin(self, port: Port, operation: str) -> str:
        """Where that QoS is set, as people read it behind a name; "" if its model says so."""
        for key in ((port.name, operation), (port.name,)):
            if (chosen := self.settings.ports.get(key)) and chosen.qos:
                return f" ({self.place(*key, 'qos')})"
        return ""

    def source(self, port: Port, aim: Aim) -> tuple[str, str, str]:
        """Whose channels a port that uses an interface looks for: namespace, instance and interface."""
        return names.resolve(aim.source, self.settings.namespace, port.interface.short)

    def aim_origin(self, port: Port, operation: str, aim: Aim) -> str:
        """Where the middleware of an aim was chosen, for people."""
        return self.document.place(("ports", port.name, "also")) if aim.said == "also" else self.origin(port, operation)

    def outside(self, port: Port, operation: str, aim: Aim) -> str:
        """Where a port finds something outside of the network, as its options say; "" if it finds nothing there."""
        middleware = aim.middleware or self.middleware(port, operation)
        channel = names.channel(*self.source(port, aim), operation)
        return deployment_of(middleware).outside(self.settings.transports.get(middleware, {}), channel)

    def operations(self, *, providing: bool) -> Iterator[tuple[Port, str]]:
        yield from ((port, operation) for port, operation, _ in self.patterns(providing=providing))

    def patterns(self, *, providing: bool | None = None) -> Iterator[tuple[Port, str, Pattern]]:
        """Its operations, or those that it provides, or those that it uses. An action counts as one query."""
        for port in self.component.ports:
            if providing in (None, port.verb.provides):
                yield from ((port, operation.name, pattern) for operation, pattern in port.interface.under(port.verb))
                yield from ((port, each.name, Pattern.QUERY) for each in port.interface.actions_under(port.verb))

    def interfaces_over(self, middleware: str, ways: Iterable[Carried]) -> list[str]:
        """What channels call the interfaces that it implements over a middleware, by its settings or by these ways.

        Those of a named instance have its name in front: `front/Laser`.
        """
        over = [way for way in ways if (way.middleware, way.provider) == (middleware, self.name)]
        used = {names.within(way.named, names.segment(way.channel)) for way in over if not way.verb.is_topic}
        found = []
        for part in self.parts:
            for port in part.component.ports:
                if port.verb is Verb.IMPLEMENTS:
                    name = names.within(part.instance if part.owner else "", part.component.segment(port))
                    operations = port.interface.called(port.verb)
                    chosen = (part.settings.middlewares(port, each, part.generated_for) for each in operations)
                    if name in used or any(middleware in each for each in chosen):
                        found.append(name)
        return found

    def has_topics_over(self, middleware: str) -> bool:
        """Whether it publishes or subscribes over a middleware."""
        return any(
            middleware in part.settings.middlewares(port, name, part.generated_for)
            for part in self.parts
            for port, name, pattern in part.patterns()
            if pattern is Pattern.PUBLISH or name in [each.name for each in port.interface.actions]
        )

    def offers(self, wanted: Port, segment: str | None = None) -> list[Port]:
        """Its ports that offer what a port of another instance uses; with a segment, those of that name in channels."""
        verb = Verb.IMPLEMENTS if wanted.verb is Verb.REQUIRES else Verb.PUBLISHES
        ports = [p for p in self.component.ports if p.verb is verb and p.interface.short == wanted.interface.short]
        return [port for port in ports if segment in (None, self.component.segment(port))]


def _named(middleware: str) -> str:
    return "" if is_auto(middleware) else middleware


def _further(own: Aim, way: Way) -> Aim:
    source = own.source if way.source is None else way.source
    return Aim(source, own.middleware if way.middleware is None else _named(way.middleware or AUTO), "also")


def unfit(middleware: str) -> Fault | None:
    """Why a middleware cannot carry a network, if it cannot."""
    known = installed.transports()
    if middleware not in known:
        hint = did_you_mean(middleware, known) or f"installed: {', '.join(known)}"
        return Fault("unknown-middleware", f"no middleware `{middleware}`", hint)
    try:
        find_transport(middleware)
    except ConfigurationError as exc:
        return Fault("unfit-middleware", str(exc))
    return None


def stays_inside(middleware: str) -> bool:
    """Whether a middleware does not reach other processes."""
    if unfit(middleware):
        return False  # nothing is known of it
    capabilities = getattr(find_transport(middleware), "capabilities", Capability.CROSS_PROCESS)
    return Capability.CROSS_PROCESS not in capabilities


def unshared(middleware: str, instance: str) -> Fault:
    """An instance that has a process of its own with a middleware that stays inside of it."""
    message = f"`{middleware}` does not reach other processes, and `{instance}` is alone in its own"
    return Fault("unfit-middleware", message, "put it and its peers into one process: process NAME;", instance)


class ByChannel:
    """The instances of a network, by how channels are called."""

    def __init__(self, configured: Iterable[Configured]) -> None:
        self._called: dict[tuple[str, str], list[Configured]] = {}
        for each in configured:
            for name in (each.instance, names.ANY):
                self._called.setdefault((each.settings.namespace, name), []).append(each)

    def called(self, namespace: str, instance: str) -> Sequence[Configured]:
        """Those of that name, or all in a namespace."""
        return self._called.get((namespace, instance), ())


def check_routes(configured: Sequence[Configured], instances: Collection[str], told: Collection[str]) -> list[Fault]:
    """What is wrong between instances. `instances` names all of the network, also those not configured by us, as they
    are called in channels, with their namespaces; `told` are the middlewares whose unfitness has been told already.
    """
    found = [fault for each in configured for fault in _unfit_choices(each, told)]
    by_channel = ByChannel(configured)
    beside: dict[str, set[str]] = {}
    for channels in instances:
        namespace, _, name = channels.rpartition("/")
        beside.setdefault(namespace, set()).add(name)
    for client in configured:
        for port, operation in client.operations(providing=False):
            for aim in client.aims(port, operation):
                if not client.outside(port, operation, aim):
                    found += _check_aim(client, port, aim, by_channel, beside)
            for aim, server, theirs in met(client, port, operation, by_channel):
                found += _check_ends(client, port, aim, server, theirs, operation)
    return worth_telling(found)


def worth_telling(faults: Iterable[Fault]) -> list[Fault]:
    """The first fault of each subject."""
    once: dict[tuple[str, ...], Fault] = {}
    for fault in faults:
        once.setdefault((fault.code, *(fault.subject or (fault.message,))), fault)
    return list(once.values())


def providers(
    client: Configured, port: Port, aim: Aim, by_channel: ByChannel
) -> Iterator[tuple[Configured, list[Port]]]:
    """The instances whose channels a port looks for, with their ports that offer what it uses."""
    namespace, instance, segment = client.source(port, aim)
    for server in by_channel.called(namespace, instance):
        if server.runs_as == client.runs_as and instance == names.ANY:
            continue  # any instance is any other one
        yield server, server.offers(port, None if instance == names.ANY else segment)


def met(client: Configured, port: Port, operation: str, by_channel: ByChannel) -> list[tuple[Aim, Configured, Port]]:
    """Each provider that a port uses, once: by the first aim that suits it, or else by the first that means it."""
    found: dict[tuple[str, str], list[tuple[Aim, Configured, Port]]] = {}
    for aim in client.aims(port, operation):
        for server, offers in providers(client, port, aim, by_channel):
            for theirs in offers:
                found.setdefault((server.name, theirs.name), []).append((aim, server, theirs))
    return [next((way for way in ways if _suits(*way, operation)), ways[0]) for ways in found.values()]


def _suits(aim: Aim, server: Configured, theirs: Port, operation: str) -> bool:
    """Whether a provider offers an operation over what an aim names, or leaves that open."""
    if aim.is_link and not server.is_program:
        return True
    offered = server.settings.middlewares(theirs, operation, server.generated_for)
    return not aim.middleware or not server.named(theirs, operation) or aim.middleware in offered


def _unfit_choices(each: Configured, told: Collection[str]) -> Iterator[Fault]:
    ports = [*each.operations(providing=True), *each.operations(providing=False)]
    for name, origin in dict.fromkeys((each.middleware(*at), each.origin(*at)) for at in ports):
        if name and name not in told and _is_unfit(each, name):
            fault = unfit(name) or unshared(name, each.name)
            message = f"`{each.name}` ({origin}): {fault.message}"
            yield Fault(fault.code, message, fault.hint, each.name, origin=origin, reason=fault.message)
    further = [(way.middleware or "", port) for port, at in ports for way in each.settings.port(port, at).also or ()]
    for name, port in further:
        if _named(name) and (absent := unfit(name)):
            origin = each.document.place(("ports", port.name, "also"))
            yield Fault(absent.code, f"`{each.name}` ({origin}): {absent.message}", absent.hint, each.name)


def _is_unfit(each: Configured, middleware: str) -> bool:
    """Whether a middleware cannot carry any message of an instance, for any peer."""
    return unfit(middleware) is not None or (not each.process and stays_inside(middleware))


def _check_aim(
    client: Configured, port: Port, aim: Aim, by_channel: ByChannel, beside: Mapping[str, Collection[str]]
) -> Iterator[Fault]:
    """Check that the named instance exists and offers what is used. `beside` has the instances of each namespace."""
    namespace, instance, segment = client.source(port, aim)
    if namespace not in beside and namespace != client.settings.namespace:
        return  # another network's, of which nothing is known here
    if instance != names.ANY and instance not in beside.get(namespace, ()):
        origin = client.document.place(("ports", port.name, aim.said))
        there = beside.get(namespace) or set().union(*beside.values())
        message = f"`{client.name}` ({origin}): {unknown('instance', instance, there)}"
        yield Fault("unknown-instance", message, "", client.name)
        return
    found = list(providers(client, port, aim, by_channel)) if instance != names.ANY else []
    if found and not any(offers for _, offers in found):
        what = "implement" if port.verb is Verb.REQUIRES else "publish"
        origin = client.document.place(("ports", port.name, aim.said))
        message = f"`{client.name}` ({origin}): `{found[0][0].name}` does not {what} `{segment}`"
        yield Fault("no-provider", message, "", client.name)


def unmet(
    port: Port, asked: QoS, provider: str, offered: QoS, *, client: str = "", said: tuple[str, str] = ("", "")
) -> Iterator[Fault]:
    """What a port of a subscriber asks for that a publisher does not offer. `said` is where each is set."""
    for each in shortfalls(asked, offered):
        what = f"`{port.interface.short}` is asked for with `{each.asked}`{said[0]}"
        given = f"`{each.offered}`" if each.offered else f"no `{each.policy}`"
        message = f"{what}, but `{provider}` offers {given}{said[1]}"
        subject = (client, port.name, provider, each.policy)
        yield Fault("qos-mismatch", message, f"publish it with qos({each.asked})", client, subject, provider, port.name)


def _check_ends(
    client: Configured, port: Port, aim: Aim, server: Configured, theirs: Port, operation: str
) -> Iterator[Fault]:
    if port.verb.is_topic:
        said = client.qos_origin(port, operation), server.qos_origin(theirs, operation)
        asked, offered = client.qos(port, operation), server.qos(theirs, operation)
        yield from unmet(port, asked, server.name, offered, client=client.name, said=said)
    mine, other = aim.middleware, server.named(theirs, operation)
    here, there = mine or other, other or mine  # an end without a choice follows the other
    if not here:
        return
    if any(name and _is_unfit(end, name) for end, name in ((client, mine), (server, other))):
        return  # reported already
    what = f"`{port.interface.short}.{operation}`"
    subject = (client.name, port.name, server.name)
    if not _suits(aim, server, theirs, operation):
        message = (
            f"`{client.name}` uses {what} over `{here}` ({client.aim_origin(port, operation, aim)}), "
            f"but `{server.name}` offers it over `{there}` ({server.origin(theirs, operation)})"
        )
        yield Fault("middleware-mismatch", message, "choose one for both", client.name, subject)
    elif stays_inside(here) and not client.is_with(server):
        origin = client.aim_origin(port, operation, aim) if mine else server.origin(theirs, operation)
        message = (
            f"{what} of `{server.name}` does not reach `{client.name}`, which is in another process, "
            f"over `{here}` ({origin})"
        )
        hint = "put both into one process, or choose another middleware"
        yield Fault("unfit-middleware", message, hint, client.name, subject)
