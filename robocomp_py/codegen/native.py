"""Files for programs without robocomp_py that communicate with a component: `generic/<middleware>/`.

    channels.json   all channels of the component, and their messages (docs/guides/native.md)
    *.idl           the types of messages in CDR; the types of MessagePack are in channels.json

A transport may have a third entry point for this, of the group `robocomp_py.natives`. It is a function of the channels
of a component and of the heading of generated files, and returns texts by name and the content of `channels.json`.

Channel names are those of a component without deployment.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from .. import installed
from ..contract import types as t
from ..contract.component import Component, Port
from ..contract.interface import Interface, Operation, Pattern, Verb, calls_of, qos_of, topics_of
from ..contract.qos import TIMES
from ..wire import names
from . import omgidl

NATIVES = "robocomp_py.natives"

Json = dict[str, Any]


@dataclass(frozen=True)
class Use:
    """An operation of a port, and its channel."""

    port: Port
    operation: Operation[Any]
    pattern: Pattern
    channel: str

    @property
    def messages(self) -> tuple[tuple[str, bool], ...]:
        """The kinds of messages, and whether the component receives them."""
        called = not self.port.verb.has_proxy
        match self.pattern:
            case Pattern.PUBLISH:
                return (("publication", called),)
            case Pattern.COMMAND:
                return (("request", called),)
            case Pattern.QUERY:
                return (("request", called), ("reply", not called))


Native = Callable[[list[Use], str], tuple[dict[str, str], Json]]
"""The type of these entry points."""


def native(component: Component, middleware: str, about: str) -> dict[str, str]:
    """The files for each middleware of the component, by path. `about` is their heading."""
    texts: dict[str, str] = {}
    for name in dict.fromkeys((middleware, *filter(None, (port.middleware for port in component.ports)))):
        uses = [use for use in _uses(component) if (use.port.middleware or middleware) == name]
        if uses and name in installed.entries(NATIVES):
            list_of = {"about": about, "component": component.name, "middleware": name}
            write: Native = installed.load(NATIVES, name)
            files, more = write(uses, about)
            files["channels.json"] = written(list_of | more) + "\n"
            texts |= {f"generic/{name}/{file}": text for file, text in files.items()}
    return texts


def _uses(component: Component) -> Iterator[Use]:
    """Every channel once, in the order of the ports."""
    seen = set()
    for whole, port in ((one, each) for one in component.ports for each in (one, *_ports_of_actions(one))):
        instance = component.name.lower() if whole.verb.provides and not port.each else names.ANY
        segment = component.segment(whole) if whole.verb.provides else port.interface.short
        for operation, pattern in port.interface.under(port.verb):
            channel = names.channel("", instance, segment, operation.name)
            if (port.verb, channel, port.middleware) not in seen:
                seen.add((port.verb, channel, port.middleware))
                yield Use(port, operation, pattern, channel)


def _ports_of_actions(port: Port) -> list[Port]:
    """Ports for the parts of its actions, as if they were operations: for its queries, and for each of its topics."""
    if not port.interface.actions_under(port.verb):
        return []
    verb = Verb.PUBLISHES if port.verb.provides else Verb.SUBSCRIBES
    topics = topics_of(port.interface).operations
    found = [replace(port, interface=calls_of(port.interface))]
    for each in topics:
        found.append(replace(port, verb=verb, interface=Interface(port.interface.name, (each,)), qos=qos_of(each)))
    return found


def channels(uses: Iterable[Use], address: Callable[[Use, str], Json]) -> list[Json]:
    return [_described(use, address) for use in uses]


def _described(use: Use, address: Callable[[Use, str], Json]) -> Json:
    operation = use.operation
    found: Json = {
        "channel": use.channel,
        "operation": f"{operation.interface}.{operation.name}",
        "verb": use.port.verb.value,
        "pattern": use.pattern.value,
        "fingerprint": f"{operation.fingerprint:016x}",
        "messages": [
            {"kind": kind, "direction": "in" if incoming else "out", **address(use, kind), "type": _type(use, kind)}
            for kind, incoming in use.messages
        ],
    }
    if operation.raises:
        found["raises"] = [each.name for each in operation.raises]
    if use.pattern is Pattern.PUBLISH:
        qos = use.port.qos
        found["qos"] = {"reliability": qos.reliability.value, "durability": qos.durability.value, "depth": qos.depth}
        found["qos"] |= {name: seconds for name in TIMES if (seconds := getattr(qos, name)) is not None}
        if qos.lease is not None:
            found["qos"]["liveliness"] = qos.liveliness.value
    return found


def _type(use: Use, kind: str) -> str:
    match kind:
        case "publication":
            return omgidl.publication_name(use.operation)
        case "request":
            return use.operation.request.name
        case _:
            return use.operation.response.name


def structs(uses: Iterable[Use], *, headed: bool) -> list[t.Struct]:
    """The types of all messages."""
    make = {"publication": omgidl.publication, "request": omgidl.request, "reply": omgidl.response}
    return [make[kind](use.operation, headed=headed) for use in uses for kind, _ in use.messages]


def exceptions(uses: Iterable[Use]) -> list[t.Struct]:
    kinds = {kind.name: kind for use in uses for kind in use.operation.raises}
    return [omgidl.exception(kind) for kind in kinds.values()]


def layout(kind: t.Struct | t.Enumeration) -> Json:
    if isinstance(kind, t.Enumeration):
        return {"enumeration": dict(kind.members)}
    return {"struct": [[field.name, t.spell(field.type)] for field in kind.fields]}


_HEADERS = {
    "publication": "version uint8, fingerprint uint64, source uint64, sequence uint64, stamp int64",
    "request": "version uint8, flags uint8, fingerprint uint64, client uint64, sequence uint64, remaining_ms uint32",
    "reply": "version uint8, status uint8, client uint64, sequence uint64, server uint64",
}
"""The headers of `wire/header.py`: little-endian, without padding."""


def headers(uses: Iterable[Use]) -> Json:
    there = {kind for use in uses for kind, _ in use.messages}
    return {kind: [each.split() for each in text.split(", ")] for kind, text in _HEADERS.items() if kind in there}


# -- JSON ------------------------------------------------------------------------------

WIDTH = 120


def written(value: Any, indent: int = 0, before: int = 0) -> str:
    """JSON for readers: a value on one line if it fits after `before` characters, otherwise one item per line."""
    line = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, dict | list) or (indent and indent + before + len(line) < WIDTH):
        return line
    margin = " " * (indent + 2)
    if isinstance(value, list):
        items = [written(each, indent + 2) for each in value]
    else:
        keys = {key: f"{json.dumps(key, ensure_ascii=False)}: " for key in value}
        items = [f"{keys[key]}{written(each, indent + 2, len(keys[key]))}" for key, each in value.items()]
    opening, closing = "[]" if isinstance(value, list) else "{}"
    return opening + "\n" + ",\n".join(f"{margin}{each}" for each in items) + f"\n{' ' * indent}{closing}"
