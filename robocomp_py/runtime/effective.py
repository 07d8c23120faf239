"""The effective configuration as TOML that can be read again, each value with the place it came from."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

from ..contract.component import Component, Port
from ..contract.middleware import carrier, is_auto
from ..contract.parameters import Key, ParameterSet, dotted
from ..contract.qos import PRESETS, QoS
from .document import Document
from .settings import PortSettings, Settings, Way

_ROOM = 40
"""Column of the comments."""


@dataclass(frozen=True)
class Value:
    """A key of the configuration, its value, and where the value comes from."""

    key: Key
    value: Any
    origin: str


@dataclass(frozen=True)
class Table:
    """The table that the following keys belong to: an item of a list if its key ends with a number."""

    key: Key


def effective(component: Component, settings: Settings, document: Document, middleware: str) -> list[Value | Table]:
    """All settings, in the order of a file. The component was generated for `middleware`."""
    found: list[Value | Table] = []
    look = _Look(document)
    found += [
        look.value(("namespace",), settings.namespace),
        look.value(("middleware",), carrier(settings.middleware, middleware), _generated(middleware)),
        Table(("component",)),
        look.value(("component", "period"), settings.period),
        look.value(("component", "log"), settings.log),
        look.value(("component", "startup_timeout"), settings.startup_timeout),
        *([] if settings.watchdog is None else [look.value(("component", "watchdog"), settings.watchdog)]),
        *([look.value(("component", "diary"), settings.diary)] if settings.diary else []),
    ]
    if component.timers:
        found.append(Table(("timers",)))
        found += [look.value(("timers", name), period, "its .cdsl") for name, period in settings.timers.items()]
    if component.params:
        found.append(Table(("params",)))
        found += _params(look, component.params, settings.params, ("params",))
    for port in component.ports:
        found += _port(look, port, settings, middleware)
    for name, tables in (settings.offers or {}).items():
        for key, of_port in tables.items():
            found.append(Table(("offers", name, *key)))
            found += _members(look, of_port, ("offers", name, *key))
    for name, options in settings.transports.items():
        found.append(Table(("transports", name)))
        found += [look.value(("transports", name, key), value) for key, value in options.items()]
    return found


def as_toml(found: list[Value | Table]) -> str:
    lines: list[str] = []
    for each in found:
        match each:
            case Table(key):
                name = ".".join(_bare(part) for part in key if isinstance(part, str))
                lines += ["", f"[[{name}]]" if isinstance(key[-1], int) else f"[{name}]"]
            case Value(key, value, origin):
                lines.append(f"{f'{_bare(str(key[-1]))} = {toml(value)}':<{_ROOM}} # {_printable(origin)}")
    return "\n".join(lines) + "\n"


def as_json(found: list[Value | Table]) -> str:
    """One JSON object per line: key, value and origin."""
    values = (each for each in found if isinstance(each, Value))
    rows = ({"key": dotted(each.key), "value": _plain(each.value), "from": each.origin} for each in values)
    return "".join(f"{json.dumps(row, default=str)}\n" for row in rows)


def _generated(middleware: str) -> str:
    """The origin of the middleware if no configuration sets it."""
    return "default" if is_auto(middleware) else "what it was generated for"


class _Look:
    """Looks up where the values of a document come from."""

    def __init__(self, document: Document) -> None:
        self._document = document

    def value(self, key: Key, value: Any, otherwise: str = "default") -> Value:
        return Value(key, value, self.origin(key) or otherwise)

    def origin(self, key: Key) -> str:
        """The place that sets a key; "" if it has its default."""
        document = self._document
        if origin := document.overridden(key):
            return origin
        return document.place(key) if document.says(key) else ""


def _params(look: _Look, spec: ParameterSet, values: Mapping[str, Any], at: Key) -> Iterator[Value | Table]:
    for parameter in spec.parameters:
        yield look.value((*at, parameter.name), values[parameter.name])
    for each in spec.lists:
        if not values[each.name]:
            yield look.value((*at, each.name), [])
    for each in spec.lists:
        for number, item in enumerate(values[each.name]):
            yield Table((*at, each.name, number))
            yield from _params(look, each.items, item, (*at, each.name, number))


def _port(look: _Look, port: Port, settings: Settings, middleware: str) -> Iterator[Value | Table]:
    """The settings of a port, then those of its operations that differ."""
    above = settings.ports.get((port.name,), PortSettings())
    chosen = settings.port(port, "")
    at: Key = ("ports", port.name)
    yield Table(at)
    general = "its .cdsl" if port.middleware else look.origin(("middleware",)) or _generated(middleware)
    said = {f.name for f in fields(PortSettings) if getattr(above, f.name) is not None}
    yield look.value((*at, "middleware"), carrier(chosen.middleware, middleware), general)
    if chosen.also:
        yield look.value((*at, "also"), chosen.also)
    if not port.verb.provides:
        yield look.value((*at, "from"), chosen.source or "")
    if port.verb.has_proxy:
        yield look.value((*at, "deadline"), chosen.deadline)
    yield look.value((*at, "qos"), chosen.qos, "default" if "qos" in said or port.qos == QoS() else "its .cdsl")
    for (name, *inner), of_operation in settings.ports.items():
        if name == port.name and inner:
            yield Table((*at, *inner))
            yield from _members(look, of_operation, (*at, *inner))


def _members(look: _Look, given: PortSettings, at: Key) -> Iterator[Value]:
    for member, key in _MEMBERS.items():
        value = getattr(given, member)
        if value is not None:
            yield look.value((*at, key), value)


_MEMBERS = {"middleware": "middleware", "source": "from", "deadline": "deadline", "qos": "qos", "also": "also"}


def toml(value: Any) -> str:
    """A value as TOML."""
    value = _plain(value)
    match value:
        case bool():
            return str(value).lower()
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
        case int() | float():
            return repr(value)
        case Mapping():
            inner = ", ".join(f"{_bare(str(key))} = {toml(each)}" for key, each in value.items())
            return f"{{ {inner} }}" if inner else "{}"
        case list() | tuple():
            return f"[{', '.join(map(toml, value))}]"
    return str(value)  # dates and times


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    if isinstance(value, Way):
        said = {_MEMBERS[f.name]: getattr(value, f.name) for f in fields(Way) if getattr(value, f.name) is not None}
        return value.middleware if said.keys() == {"middleware"} else said
    if not isinstance(value, QoS):
        return value
    preset = next((name for name, each in PRESETS.items() if each == value), "")
    said = {f.name: getattr(value, f.name) for f in fields(QoS) if getattr(value, f.name) != f.default}
    return preset or {name: each if isinstance(each, int | float) else str(each) for name, each in said.items()}


def _bare(name: str) -> str:
    """A key as TOML, with quotes if it needs them."""
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else toml(name)


def _printable(text: str) -> str:
    return "".join(char if char.isprintable() else " " for char in text)
