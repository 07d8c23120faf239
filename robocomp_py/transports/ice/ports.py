"""Checks and completes the options of Ice (`transports.ice`) for the ports of a component that use Ice.

This comes last, because all other settings decide which transport a port uses. If `proxies` has an entry with the name
of a port that requires an interface, the port uses it: `from` need not name it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from ...contract.component import Component, Port
from ...contract.interface import Verb
from ...contract.middleware import carrier
from ...contract.parameters import Complaint, Key
from ...spelling import unknown
from ...wire import names
from ..deployment import Completion, Incomplete, SettingsOfPorts

ICE = "ice"
AT: Key = ("transports", ICE)


def complete(options: Mapping[str, Any], of: Incomplete) -> Iterator[Complaint | Completion]:
    """Complaints about the tables of the options, and the sources of ports for which there is a proxy."""
    ports = Ports(of.component, of.own, of.settings(), of.generated_for)
    yield from _unknown_keys(options, ports, is_overridden=of.is_overridden)
    proxies = _table(options, "proxies")
    for port in ports.using:
        key = next((name for name in (port.label, port.name) if name in proxies), None)
        for at in ports.without_source(port) if key else ():
            yield Completion((*at, "from"), key, (*AT, "proxies", str(key)))


def _unknown_keys(options: Mapping[str, Any], ports: Ports, *, is_overridden: bool) -> Iterator[Complaint]:
    """Complaints about keys that name no port of this component."""
    component = ports.component
    served = [component.segment(port) for port in ports.every if port.verb is Verb.IMPLEMENTS]
    served += [f"{port.interface.short}Topic" for port in component.ports if port.verb is Verb.SUBSCRIBES]
    yield from _unknown("endpoints", options, served)
    published = [port.interface.short for port in component.ports if port.verb.is_topic]
    yield from _unknown("topics", options, published, published)
    if is_overridden:
        return  # the file may still name sources that are not used any more
    using = [port for port in component.ports if port.verb is Verb.REQUIRES]
    sources = [each.source for each in ports.settings.ports.values() if each.source]
    named = [names.resolve(source, "", "") for source in sources if _is_source(source)]
    interfaces = [*(port.interface.short for port in using), *(segment for _, _, segment in named if segment)]
    alone = [*(port.label for port in using), *(instance for _, instance, _ in named), *(port.name for port in using)]
    yield from _unknown("proxies", options, dict.fromkeys(alone), interfaces)


def _is_source(text: str) -> bool:
    try:
        names.resolve(text, "", "X")
    except ValueError:
        return False  # reported for the port
    return True


def _unknown(
    name: str, options: Mapping[str, Any], alone: Iterable[str], interfaces: Sequence[str] = ()
) -> Iterator[Complaint]:
    """Complaints about unknown keys of a table; after a slash, a key names an interface."""
    for key in _table(options, name):
        last = key.rpartition("/")[2]
        known = list(interfaces if "/" in key and interfaces else alone)
        if last not in known:
            yield Complaint((*AT, name, key), unknown("key", last, known), "config-unknown-key")


class Ports:
    """The ports of a component, by the transports that they use."""

    def __init__(self, component: Component, own: Port | None, settings: SettingsOfPorts, generated_for: str) -> None:
        """`own` is the port of its `CommonBehavior`, `generated_for` the middleware of its generic part."""
        self.component, self.settings = component, settings
        self._generated_for = generated_for
        self.every = (*component.ports, own) if own else component.ports
        self.using = [port for port in component.ports if port.verb is Verb.REQUIRES and self.carried(port)]

    def called(self, name: str, *verbs: Verb) -> Port | None:
        """The port with that name."""
        among = (port for port in self.every if port.verb in verbs)
        return next((port for port in among if port.label.lower() == name.lower()), None)

    def of(self, interface: str, verb: Verb) -> list[Port]:
        """All ports of an interface with that verb."""
        return [port for port in self.every if port.verb is verb and port.interface.short.lower() == interface.lower()]

    def carried(self, port: Port) -> list[str]:
        """The operations of a port that use Ice."""
        operations = port.interface.called(port.verb)
        if port not in self.component.ports:  # its `CommonBehavior`
            return operations if carrier(self.settings.middleware, self._generated_for) == ICE else []
        return [name for name in operations if ICE in self.settings.middlewares(port, name, self._generated_for)]

    def elsewhere(self, port: Port) -> str:
        """The transport of a port that does not use Ice."""
        operations = port.interface.called(port.verb)
        if port not in self.component.ports:
            return carrier(self.settings.middleware, self._generated_for)
        return next((self.settings.middlewares(port, name, self._generated_for)[0] for name in operations), "")

    def without_source(self, port: Port) -> Iterator[Key]:
        """The keys for a missing source: that of the port, or those of its operations that use Ice."""
        carried = self.carried(port)
        operations = port.interface.called(port.verb)
        said = self.settings.ports
        if (found := said.get((port.name,))) and found.source:
            return
        if len(carried) == len(operations):
            yield "ports", port.name
            return
        for name in carried:
            if not ((found := said.get((port.name, name))) and found.source):
                yield "ports", port.name, name

    @property
    def has_topics(self) -> bool:
        return any(port.verb.is_topic and self.carried(port) for port in self.every)

    @property
    def any_carried(self) -> bool:
        return any(map(self.carried, self.every))


def _table(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = data.get(name)
    return value if isinstance(value, Mapping) else {}
