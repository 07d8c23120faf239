"""Converts the lines of RoboComp's configuration that configure Ice into options of `transports.ice`.

They apply to ports over Ice. Any other setting of the same option takes precedence.

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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Any

from ..contract.component import Component, Port
from ..contract.interface import Verb
from ..contract.parameters import Key
from ..runtime.commonbehavior import port_of
from ..runtime.document import Document, Note, put
from ..runtime.settings import examine
from ..transports.ice.ports import AT, Ports
from ..transports.iceoptions import MOST_BYTES, why_not_set


class OfIceKind(StrEnum):
    PROXY = "proxy"
    ENDPOINTS = "endpoints"
    TOPIC = "topic"
    PREFIX = "prefix"
    STORM = "storm"
    PROPERTY = "property"


@dataclass(frozen=True)
class OfIce:
    """A line that configures Ice."""

    kind: OfIceKind
    name: str
    """The interface that it configures, or the name of a property without `Ice.`."""
    value: str
    note: Note
    """The note about it if it has no effect."""


def add(document: Document, lines: Sequence[OfIce]) -> None:
    """Have a document apply these lines after all its other settings."""
    document.peers = {line.name.lower(): line.value for line in reversed(lines) if line.kind is OfIceKind.PROXY}
    document.complete = partial(_take, lines) if lines else None


def _take(lines: Sequence[OfIce], document: Document, component: Component, generated_for: str) -> None:
    settings, _ = examine(component, document)
    _Reading(document, Ports(component, port_of(component), settings, generated_for)).take(lines)


@dataclass(frozen=True)
class _Taken:
    """The option and value of a line, or the reason why it has none."""

    key: Key = ()
    value: Any = None
    why: str = ""


class _Reading:
    """Puts the lines for Ice into the options."""

    def __init__(self, document: Document, ports: Ports) -> None:
        self._document, self._ports = document, ports
        self._proxies: list[str] = []

    def take(self, lines: Sequence[OfIce]) -> None:
        self._proxies = [line.name for line in lines if line.kind is OfIceKind.PROXY]
        notes = {line.note: self._note(line, self._taken(line)) for line in lines}
        self._document.notes = tuple(notes.get(note, note) for note in self._document.notes)

    def _note(self, line: OfIce, taken: _Taken) -> Note:
        """Set the option; returns the note about it."""
        key = (*AT, *taken.key)
        if not taken.key:
            return replace(line.note, why=taken.why or line.note.why)
        if self._says(key):
            return replace(line.note, why=f"{line.note.why}, which {self._document.place(key)} says")
        put(self._document.data, key, taken.value)
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
            return _Taken(why=f"where Ice finds an interface; {said} sets the source instead")
        return _Taken(("proxies", port.label), line.value)

    def _required(self, name: str) -> Port | None:
        """The port of a proxy. Some files number several proxies: `RGBD1`, `RGBD2`, or from 0."""
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
        """Why a line has no effect: its port does not use Ice."""
        if port and (other := self._ports.elsewhere(port)):
            return _Taken(why=f"{line.note.why.partition(';')[0]}, and `{port.label}` goes over {other}")
        return _Taken()
