"""The links of a network: each port of an instance, and the ports that offer what it uses.

A wiring of the network decides. Without one, the providers of the same system count; if there are none, those of the
system around it, and so on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field

from ..contract.component import Component, Port
from ..contract.interface import Verb, differences
from ..dsl.ddsl.model import Deployment, Instance, Quality, Wiring
from ..dsl.ddsl.scope import around, whole
from ..dsl.diagnostics import Report, did_you_mean
from ..dsl.source import Name
from ..dsl.workspace import LinkedComponent
from ..plugins import as_run
from ..wire import names
from . import placing
from .plan import Link
from .routes import unmet


@dataclass
class Node:
    """An instance and what it is an instance of."""

    instance: Instance
    linked: LinkedComponent
    host: str
    """The one that it runs on; "" for the one that launches the network."""
    namespace: str
    wires: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """The provider to use, written as in `from`, by the name of the client's port."""
    carriers: dict[str, Name] = field(default_factory=dict)
    """The middlewares that the network names for single links, by the name of the port that uses."""
    qos: dict[str, Quality] = field(default_factory=dict)
    """What the network says, by the name of the port."""
    offers: dict[str, tuple[Port, ...]] = field(default_factory=dict)
    """The ports that each of its named instances provides, by the name in its system."""
    places: dict[str, Name] = field(default_factory=dict)
    """Where the network speaks of a port, by its name."""

    def place(self, port: str = "") -> Name:
        """Where errors of the instance, or of one of its ports, are reported."""
        return self.places.get(port) or self.instance.config or self.instance.name

    @property
    def name(self) -> str:
        return self.instance.name.text

    @property
    def component(self) -> Component:
        if self.instance.existing:  # a program that does not run here: its CDSL says that it speaks Ice
            return self.linked.component
        return as_run(self.linked.component, self.linked.path.parent)


def node_of(model: Deployment, instance: Instance, linked: LinkedComponent) -> Node:
    return Node(instance, linked, placing.host_name(model, instance), placing.namespace(model, instance))


def wire(
    nodes: Sequence[Node],
    model: Deployment,
    report: Report,
    is_outside: Callable[[Node, Port], bool] | None,
    imported: Sequence[Component],
) -> list[Link]:
    """Find the links of a network, and set each node's own. Errors go into the report.

    `is_outside` tells whether a port without provider in the network has one elsewhere. `imported` are
    the components that the network may have instances of.
    """
    offers: dict[tuple[Verb, str], list[_Offer]] = {}
    for each in (offer for node in nodes for offer in _offers_of(node)):
        offers.setdefault(_offers(each.port), []).append(each)
    named = {node.name for node in nodes} | {each.name for some in offers.values() for each in some}
    complete = len(nodes) == len(model.instances)
    wirers = (_Wirer(node, nodes, named, offers, complete, report, is_outside, imported) for node in nodes)
    return [link for each in wirers for link in each.links()]


@dataclass(frozen=True)
class _Offer:
    """A port of an instance, and the name by which it is provided."""

    node: Node
    port: Port
    named: str = ""
    """The named instance, in its system; "" if the instance provides it by its own name."""

    @property
    def local(self) -> str:
        return self.named or self.node.instance.local

    @property
    def name(self) -> str:
        """The full name of what provides it."""
        return whole(self.node.instance.system, self.local)

    @property
    def place(self) -> Name:
        """Where the network speaks of it."""
        return self.node.places.get(f"{self.named}/{self.port.name}") or self.node.instance.name


def _offers_of(node: Node) -> Iterator[_Offer]:
    yield from (_Offer(node, port) for port in node.component.ports if not port.each)
    yield from (_Offer(node, port, name) for name, ports in node.offers.items() for port in ports)


@dataclass
class _Wirer:
    """The uses of one instance."""

    node: Node
    nodes: Sequence[Node]
    """All of the network."""
    named: Set[str]
    """All instances, and all named instances."""
    offers: Mapping[tuple[Verb, str], Sequence[_Offer]]
    """By what they do with which interface."""
    complete: bool
    """Whether those are all instances of the network."""
    report: Report
    is_outside: Callable[[Node, Port], bool] | None
    imported: Sequence[Component]

    def links(self) -> Iterator[Link]:
        node = self.node
        wirings: dict[str, Wiring] = {}
        astray: set[Verb] = set()
        """Of wirings whose port is not there: they may be meant for any port that has none."""
        for wiring in node.instance.wirings:
            port = self._wired_port(wiring)
            if port:
                wirings[port.name] = wiring
                node.places[port.name] = wiring.instance
                if wiring.middleware:
                    node.carriers[port.name] = wiring.middleware
            else:
                astray.add(Verb(wiring.verb.text))
        for port in node.component.ports:
            given = wirings.get(port.name)
            lost = given.instance.text not in self.named if given else port.verb in astray
            if not port.verb.provides and not lost:
                yield from self._wire_port(port, given)

    def _wired_port(self, wiring: Wiring) -> Port | None:
        verb, component = Verb(wiring.verb.text), self.node.component
        ports = {port.label: port for port in component.ports if port.verb is verb}
        if wiring.port.text not in ports:
            message = f"`{component.name}` has no `{verb} {wiring.port}`"
            hint = did_you_mean(wiring.port.text, ports) or (f"it has: {', '.join(ports)}" if ports else "")
            self._error("unknown-port", message, wiring.port, hint)
        return ports.get(wiring.port.text)

    def _wire_port(self, port: Port, wiring: Wiring | None) -> Iterator[Link]:
        node = self.node
        at = wiring.instance if wiring else node.instance.name
        if wiring:
            offers = [offer for offer in self.offers.get(_uses(port), ()) if offer.name == wiring.instance.text]
            if not offers:
                what = "implement" if port.verb is Verb.REQUIRES else "publish"
                message = f"`{wiring.instance}` does not {what} `{port.interface.short}`"
                self._error("no-provider", message, at, self._named_instead(port, wiring))
                return
        else:
            offers = self._nearest(port)
        if not offers:
            if not (self.is_outside and self.is_outside(node, port)):
                self._report_no_provider(port)
            return
        providers = {offer.name: offer for offer in offers}
        if len(providers) > 1 and port.verb is Verb.REQUIRES:
            self._report_several(port, providers)
            return
        for offer in offers:
            self._check_match(port, offer.node, offer.port, at)
            yield Link(port.interface.short, offer.node.name, node.name, port.verb, offer.named)
        if len(providers) == 1:
            node.wires[port.name] = (self._source(port, offers[0]),)
        elif any(offer.node.namespace != node.namespace for offer in offers):
            sources = dict.fromkeys(self._source(port, offer) for offer in offers)
            node.wires[port.name] = tuple(sources)  # "any instance" would be one of the own system

    def _nearest(self, port: Port) -> list[_Offer]:
        """Its providers in the same system, or else in the one around it, and so on."""
        offers = [offer for offer in self.offers.get(_uses(port), ()) if offer.node is not self.node]
        for system in around(self.node.instance.system):
            if near := [each for each in offers if each.node.instance.system[: len(system)] == system]:
                return near
        return []

    def _source(self, port: Port, offer: _Offer) -> str:
        segment = offer.node.component.segment(offer.port)
        here = self.node.namespace, port.interface.short
        return names.target(offer.node.namespace, offer.local, segment, *here)

    def _named_instead(self, port: Port, wiring: Wiring) -> str:
        """A hint for an instance that provides an interface as named instances only; "" for others."""
        offers = [each for each in self.offers.get(_uses(port), ()) if each.node.name == wiring.instance.text]
        if offers:
            return " or ".join(f"{port.verb} {port.label} from {each.name};" for each in offers)
        meant = wiring.instance.text
        able = [each for each in self._able(port) if meant == each.name or meant in self._named_of(each)]
        return self._offers_to_add(port, able, meant)

    def _able(self, port: Port) -> list[Node]:
        """The instances whose components can provide what a port uses under names that the network declares."""
        return [each for each in self.nodes if any(_offers(one) == _uses(port) for one in each.component.named)]

    def _named_of(self, node: Node) -> list[str]:
        """The full names of its named instances."""
        return [each.name.text for each in node.instance.offers]

    def _report_several(self, port: Port, providers: Mapping[str, _Offer]) -> None:
        said = ", ".join(f"`{name}`" for name in providers)
        likely = list(providers)[min(int(port.number or 0), len(providers) - 1)]
        hint = f"write in its block: requires {port.label} from {likely};"
        message = f"several instances implement `{port.label}` for `{self.node.name}`: {said}"
        ones = [("one of them", each.place) for each in providers.values()]
        self._error("ambiguous-provider", message, self.node.instance.name, hint, *ones)

    def _report_no_provider(self, port: Port) -> None:
        if not self.complete:
            return  # an instance that could not be read may provide it
        node = self.node
        if port.verb is Verb.REQUIRES:
            message = f"`{node.name}` requires `{port.interface.short}`, which no component implements"
            self._error("no-provider", message, node.instance.name, self._instance_to_add(port))
        else:
            message = f"`{node.name}` subscribes to `{port.interface.short}`, which no component publishes"
            self.report.warning("no-publisher", message, node.instance.name.span, self._instance_to_add(port))

    def _instance_to_add(self, port: Port) -> str:
        """How to get an instance that offers what a port uses; "" if no imported component can."""
        if able := self._able(port):
            return self._offers_to_add(port, able)
        others = [each for each in self.imported if each.name != self.node.component.name]
        offering = [each.name for each in others if any(_offers(one) == _uses(port) for one in each.ports)]
        return f"write {' or '.join(f'`Component {name} {{ }};`' for name in offering)}" if offering else ""

    def _offers_to_add(self, port: Port, able: Sequence[Node], meant: str = "") -> str:
        """Which `offers` clause is missing, for these instances. `meant` is the name that the network uses, if it does.

        Without such a name, it is the clause that has the topics of the same device, or its calls; or else a new one.
        """
        said, short = [], port.interface.short
        device = short.removesuffix("Pub")
        for node in able:
            clauses = {each.local: [*map(str, each.interfaces)] for each in node.instance.offers}
            local = meant.rpartition("/")[2]
            likely = (name for name, interfaces in clauses.items() if {device, f"{device}Pub"} & {*interfaces})
            usual = device.lower() if clauses and device.lower() not in self.named else "front"
            name = local if meant and meant != node.name else next(likely, usual)
            interfaces = ", ".join([*clauses.get(name, ()), short])
            said.append(f"write in the block of `{node.name}`: offers {name} : {interfaces};")
        return " or ".join(said)

    def _check_match(self, port: Port, other: Node, theirs: Port, at: Name) -> None:
        offered = {operation.name: operation for operation in theirs.interface.contracts(theirs.verb)}
        for operation in port.interface.contracts(port.verb):
            match = offered.get(operation.name)
            if match is None or match.fingerprint != operation.fingerprint:
                what = "; ".join(differences(operation.text, match.text)) if match else "it is missing there"
                message = f"`{port.interface.short}.{operation.name}` is different in `{other.name}`: {what}"
                hint = "generate both from the same IDSL"
                self._error("contract-mismatch", message, at, hint, ("the other one", other.instance.name))
                return
        programs = self.node.instance.program or other.instance.program  # the others are compared as configured
        if port.verb.is_topic and programs:
            for fault in unmet(port, port.qos, other.name, theirs.qos):
                self._error(fault.code, fault.message, at, fault.hint, ("the publisher", other.instance.name))

    def _error(self, code: str, message: str, at: Name, hint: str = "", *related: tuple[str, Name]) -> None:
        self.report.error(code, message, at.span, hint, *((text, name.span) for text, name in related))


def _offers(port: Port) -> tuple[Verb, str]:
    return port.verb, port.interface.short


def _uses(port: Port) -> tuple[Verb, str]:
    """The verb and the interface of the ports that serve this one."""
    return Verb.IMPLEMENTS if port.verb is Verb.REQUIRES else Verb.PUBLISHES, port.interface.short


def read_qos(node: Node, report: Report) -> None:
    """What the network says of the QoS of an instance; what is wrong with it goes into the report."""
    for quality in node.instance.qos:
        if node.instance.program:
            message = f"`{node.name}` is your own program; its QoS cannot be set here"
            report.error("configuration", message, quality.port.span, "remove it")
        elif port := _port_of(node, quality, report):
            node.qos[port.name] = quality
            node.places[port.name] = quality.port


def _port_of(node: Node, quality: Quality, report: Report) -> Port | None:
    """The port that a `qos` clause names. Reports a name that fits no port, or several, and returns None."""
    verbs = [Verb(quality.verb.text)] if quality.verb else [Verb.PUBLISHES, Verb.SUBSCRIBES]
    there = [port for port in node.component.ports if port.verb in verbs]
    named = [port for port in there if port.label == quality.port.text]
    if len(named) == 1:
        return named[0]
    at = quality.port
    calls = [port.label for port in node.component.ports if not port.verb.is_topic]
    if named:
        ways = " or ".join(f"`qos {port.verb} {at}(…)`" for port in named)
        message = f"`{node.component.name}` publishes and subscribes to `{at}`"
        report.error("ambiguous-port", message, at.span, f"write {ways}")
    elif at.text in calls and not quality.verb:
        report.error("qos-of-calls", "only publications and subscriptions have a QoS", at.span)
    else:
        what = " or ".join(f"`{verb} {at}`" for verb in verbs)
        labels = dict.fromkeys(port.label for port in there)
        hint = did_you_mean(at.text, labels) or (f"it has: {', '.join(labels)}" if labels else "")
        report.error("unknown-port", f"`{node.component.name}` has no {what}", at.span, hint)
    return None
