"""What a configuration says of those ports of a component that go over Ice, as options of `transports.ice`.

Two things can only be said when it is known over what each port goes, that is, when everything else is set:

- who uses an interface over Ice and has a proxy for it, by the name of the port, uses that: `from` need not say so
- a file written for RoboComp tells Ice where to find and to serve what; it counts less than whatever else says that

    LaserProxy = laser:tcp -p 10003          transports.ice.proxies.Laser = "laser:tcp -p 10003"
    Laser.Endpoints = tcp -p 10003           transports.ice.endpoints.Laser = "tcp -p 10003"
    LaserPubTopic.Endpoints = tcp -p 0       transports.ice.endpoints.LaserPubTopic = "tcp -p 0"
    LaserPubTopic = zed/LaserPub             transports.ice.topics.LaserPub = "zed/LaserPub"
    Endpoints.LaserPubPrefix = "zed"         the same
    TopicManager.Proxy = …                   transports.ice.storm
    Ice.MessageSizeMax = 20480               transports.ice.message_size_max = 20971520
    Ice.Warn.Connections = 0                 transports.ice.properties."Ice.Warn.Connections" = "0"
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from ..contract.component import Component, Port
from ..contract.interface import Verb
from ..contract.parameters import Complaint, Key
from ..spelling import unknown
from ..transports.iceoptions import MOST_BYTES, why_not_set
from ..wire import names
from .commonbehavior import port_of
from .document import Document, Note, OfIce, OfIceKind
from .settings import PortSettings, Settings, carrier, examine

ICE = "ice"
_AT: Key = ("transports", ICE)


def settle(document: Document, component: Component, generated_for: str) -> None:
    """Complete a document in which everything is set; `generated_for` is the middleware of the generic part."""
    settings, _ = examine(component, document)
    ports = _Ports(component, settings, generated_for)
    document.complaints = (*document.complaints, *_unknown_keys(document, ports, settings))
    _Reading(document, ports).take(document.of_ice)
    proxies = _table(_table(_table(document.data, "transports"), ICE), "proxies")
    for port in ports.using:
        key = next((name for name in (port.label, port.name) if name in proxies), None)
        for at in ports.without_source(port) if key else ():
            _put(document.data, (*at, "from"), key)
            document.overrides.append(((*at, "from"), document.place((*_AT, "proxies", str(key)))))


def _unknown_keys(document: Document, ports: _Ports, settings: Settings) -> Iterator[Complaint]:
    """Keys of tables that are about ports, and about none of this component."""
    options = _table(_table(document.data, "transports"), ICE)
    component = ports.component
    served = [component.segment(port) for port in ports.every if port.verb is Verb.IMPLEMENTS]
    served += [f"{port.interface.short}Topic" for port in component.ports if port.verb is Verb.SUBSCRIBES]
    yield from _unknown("endpoints", options, served)
    published = [port.interface.short for port in component.ports if port.verb.is_topic]
    yield from _unknown("topics", options, published, published)
    if any(key[0] == "ports" and key[-1] == "from" for key, _ in document.overrides):
        return  # whom the file names may be somebody who is not used any more
    using = [port for port in component.ports if port.verb is Verb.REQUIRES]
    sources = [each.source for each in settings.ports.values() if each.source]
    named = [names.resolve(source, "", "") for source in sources if _is_source(source)]
    interfaces = [*(port.interface.short for port in using), *(segment for _, _, segment in named if segment)]
    alone = [*(port.label for port in using), *(instance for _, instance, _ in named), *(port.name for port in using)]
    yield from _unknown("proxies", options, dict.fromkeys(alone), interfaces)


def _is_source(text: str) -> bool:
    try:
        names.resolve(text, "", "X")
    except ValueError:
        return False  # which is told of the port
    return True


def _unknown(
    name: str, options: Mapping[str, Any], alone: Iterable[str], interfaces: Sequence[str] = ()
) -> Iterator[Complaint]:
    """Keys of a table that are not known; behind a slash, a key names an interface."""
    for key in _table(options, name):
        last = key.rpartition("/")[2]
        known = list(interfaces if "/" in key and interfaces else alone)
        if last not in known:
            yield Complaint((*_AT, name, key), unknown("key", last, known), "config-unknown-key")


class _Ports:
    """Those of a component, by where they go."""

    def __init__(self, component: Component, settings: Settings, generated_for: str) -> None:
        self.component, self._settings = component, settings
        self._generated_for = generated_for
        own = port_of(component)
        self.every = (*component.ports, own) if own else component.ports
        self.using = [port for port in component.ports if port.verb is Verb.REQUIRES and self.carried(port)]

    def called(self, name: str, *verbs: Verb) -> Port | None:
        """The one that is called so."""
        among = (port for port in self.every if port.verb in verbs)
        return next((port for port in among if port.label.lower() == name.lower()), None)

    def of(self, interface: str, verb: Verb) -> list[Port]:
        """All of an interface."""
        return [port for port in self.every if port.verb is verb and port.interface.short.lower() == interface.lower()]

    def carried(self, port: Port) -> list[str]:
        """Its operations that go over Ice."""
        operations = [operation.name for operation, _ in port.interface.under(port.verb)]
        if port not in self.component.ports:  # its `CommonBehavior`
            return operations if carrier(self._settings.middleware, self._generated_for) == ICE else []
        return [name for name in operations if ICE in self._settings.middlewares(port, name, self._generated_for)]

    def elsewhere(self, port: Port) -> str:
        """What carries a port that does not go over Ice."""
        operations = (operation.name for operation, _ in port.interface.under(port.verb))
        if port not in self.component.ports:
            return carrier(self._settings.middleware, self._generated_for)
        return next((self._settings.middlewares(port, name, self._generated_for)[0] for name in operations), "")

    def without_source(self, port: Port) -> Iterator[Key]:
        """Where to say whom it uses, if that is not said: for the port, or else for those operations over Ice."""
        carried = self.carried(port)
        operations = [operation.name for operation, _ in port.interface.under(port.verb)]
        said = self._settings.ports
        if said.get((port.name,), PortSettings()).source:
            return
        if len(carried) == len(operations):
            yield "ports", port.name
            return
        for name in carried:
            if not said.get((port.name, name), PortSettings()).source:
                yield "ports", port.name, name

    @property
    def has_topics(self) -> bool:
        return any(port.verb.is_topic and self.carried(port) for port in self.every)

    @property
    def any_carried(self) -> bool:
        return any(map(self.carried, self.every))


@dataclass(frozen=True)
class _Taken:
    """What a line comes to: an option with its value, or why there is none."""

    key: Key = ()
    value: Any = None
    why: str = ""


class _Reading:
    """Lines for Ice on their way into the options."""

    def __init__(self, document: Document, ports: _Ports) -> None:
        self._document, self._ports = document, ports
        self._proxies: list[str] = []

    def take(self, lines: Sequence[OfIce]) -> None:
        self._proxies = [line.name for line in lines if line.kind is OfIceKind.PROXY]
        notes = {line.note: self._note(line, self._taken(line)) for line in lines}
        self._document.notes = tuple(notes.get(note, note) for note in self._document.notes)

    def _note(self, line: OfIce, taken: _Taken) -> Note:
        """Put it where it belongs; what is said of it then."""
        key = (*_AT, *taken.key)
        if not taken.key:
            return replace(line.note, why=taken.why or line.note.why)
        if self._says(key):
            return replace(line.note, why=f"{line.note.why}, which {self._document.place(key)} says")
        _put(self._document.data, key, taken.value)
        if line.note.spot:
            for length in range(1, len(key) + 1):
                self._spots.setdefault(key[:length], line.note.spot)
        return replace(line.note, became=key, why="")

    @property
    def _spots(self) -> dict[Key, Any]:
        if not isinstance(self._document.spots, dict):
            self._document.spots = dict(self._document.spots or {})
        return self._document.spots

    def _says(self, key: Key) -> bool:
        table: Any = self._document.data
        for part in key:
            if not isinstance(table, Mapping) or part not in table:
                return False
            table = table[part]
        return True

    def _taken(self, line: OfIce) -> _Taken:
        match line.kind:
            case OfIceKind.PROXY:
                return self._proxy(line)
            case OfIceKind.ENDPOINTS:
                return self._endpoints(line)
            case OfIceKind.TOPIC | OfIceKind.PREFIX:
                return self._topic(line)
            case OfIceKind.STORM:
                return _Taken(("storm",), line.value) if self._ports.has_topics else _Taken()
            case OfIceKind.PROPERTY:
                return self._property(line) if self._ports.any_carried else _Taken()

    def _proxy(self, line: OfIce) -> _Taken:
        port = self._required(line.name)
        if not port or not self._ports.carried(port):
            return self._idle(line, port)
        if not any(self._ports.without_source(port)):
            said = self._document.place(("ports", port.name, "from"))
            return _Taken(why=f"where Ice finds an interface; {said} says whom to use instead")
        return _Taken(("proxies", port.label), line.value)

    def _required(self, name: str) -> Port | None:
        """The port that a proxy is for. Some files number all of several: `RGBD1`, `RGBD2`, or from 0."""
        numbered = re.fullmatch(r"(.*?)\d+", name)
        if numbered and numbered[1] not in self._proxies:
            every = [each for each in self._proxies if re.fullmatch(rf"{re.escape(numbered[1])}\d+", each)]
            ports = self._ports.of(numbered[1], Verb.REQUIRES)
            if len(every) == len(ports):
                return ports[sorted(every, key=lambda each: int(each[len(numbered[1]) :])).index(name)]
        return self._ports.called(name, Verb.REQUIRES)

    def _endpoints(self, line: OfIce) -> _Taken:
        port = self._ports.called(line.name, Verb.IMPLEMENTS)
        if port and self._ports.carried(port):
            return _Taken(("endpoints", self._ports.component.segment(port)), line.value)
        topic = self._ports.called(line.name.removesuffix("Topic"), Verb.SUBSCRIBES)
        if topic and line.name.endswith("Topic") and self._ports.carried(topic):
            return _Taken(("endpoints", f"{topic.interface.short}Topic"), line.value)
        return self._idle(line, port or topic)

    def _topic(self, line: OfIce) -> _Taken:
        port = self._ports.called(line.name, Verb.PUBLISHES, Verb.SUBSCRIBES)
        if not port or not self._ports.carried(port):
            return self._idle(line, port)
        if line.kind is OfIceKind.TOPIC:
            return _Taken(("topics", port.interface.short), line.value)
        if not line.value.strip("/"):
            return _Taken(why=f"{line.note.why}, and there is none")
        return _Taken(("topics", port.interface.short), f"{line.value.strip('/')}/{port.interface.short}")

    def _property(self, line: OfIce) -> _Taken:
        name, _, rest = line.name.partition(".")
        if line.name == "MessageSizeMax" and line.value.isascii() and line.value.isdigit():
            return _Taken(("message_size_max",), min(int(line.value[:12]) * 1024, MOST_BYTES))
        if line.name == "Default.Host" and line.value:
            return _Taken(("host",), line.value)
        if name in ("Warn", "Trace") and rest:
            if why := why_not_set(f"Ice.{line.name}", line.value):
                return _Taken(why=why)
            return _Taken(("properties", f"Ice.{line.name}"), line.value)
        return _Taken(why="a setting of Ice, which is not taken over; transports.ice.properties sets it")

    def _idle(self, line: OfIce, port: Port | None) -> _Taken:
        """Why a line has no effect whose port does not go over Ice."""
        if port and (other := self._ports.elsewhere(port)):
            return _Taken(why=f"{line.note.why.partition(';')[0]}, and `{port.label}` goes over {other}")
        return _Taken()


def _table(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = data.get(name)
    return value if isinstance(value, Mapping) else {}


def _put(data: dict[str, Any], key: Key, value: Any) -> None:
    """Set a key below tables that are made if they are missing; nothing, if something else stands in the way."""
    table: Any = data
    for part, _ in pairwise(key):
        table = table.setdefault(part, {}) if isinstance(table, dict) else None
    if isinstance(table, dict):
        table[key[-1]] = value
