"""How a component is configured: `etc/config.toml`, then what its launcher sets.

    namespace = "robot1"             the first part of its channels' names
    middleware = "zeromq"            what carries its messages
    [component]
    period = 0.05                    seconds from one compute to the next
    log = "info"                     debug, info, warning or error
    patience = 60.0                  seconds to wait at the start for those it requires
    [params]                         what its PDSL declares
    [ports.laser]                    a proxy, or a handler's prefix
    from = "world"                   the instance to use; `world/Laser1` and `/robot2/world/Laser` say more
    middleware = "zeromq"
    deadline = 0.5                   seconds a call may take
    qos = { reliability = "reliable", depth = 1 }     or a preset: "sensor_data"
    [ports.laser.getLaserData]       the same for one operation
    [transports.zeromq]              options of a transport

Everything is checked before anything is opened, and all complaints come at once, with their place.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from .. import installed
from ..contract.component import MAX_SECONDS, Component, Port
from ..contract.parameters import Complaint, ParameterSet, dotted
from ..contract.parameters import check as check_parameters
from ..contract.qos import PRESETS, Durability, History, Liveliness, QoS, Reliability
from ..errors import ConfigurationError
from ..spelling import unknown
from ..wire import names

DEADLINE = 5.0
"""Seconds a call may take, unless configuration or the caller say otherwise."""

PATIENCE = 60.0

LOG_LEVELS = ("debug", "info", "warning", "error")

Key = tuple[str | int, ...]


@dataclass(frozen=True)
class PortSettings:
    """What is set for a port or for one of its operations; None is what the level above says."""

    middleware: str | None = None
    source: str | None = None
    """`from` in the file: whose channels to use."""
    deadline: float | None = None
    qos: QoS | None = None

    def under(self, above: PortSettings) -> PortSettings:
        """These settings, completed by those of the level above."""
        given = {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) is not None}
        return replace(above, **given)


@dataclass(frozen=True)
class Settings:
    """A checked configuration."""

    instance: str
    namespace: str = ""
    middleware: str | None = None
    period: float = 0.1
    log: str = "info"
    patience: float = PATIENCE
    params: Mapping[str, Any] = field(default_factory=dict)
    ports: Mapping[tuple[str, ...], PortSettings] = field(default_factory=dict)
    """By (port,) and (port, operation)."""
    transports: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def port(self, port: Port, operation: str) -> PortSettings:
        """What holds for one operation of a port."""
        base = PortSettings(port.middleware or self.middleware, "", DEADLINE, port.qos)
        of_port = self.ports.get((port.name,), PortSettings()).under(base)
        return self.ports.get((port.name, operation), PortSettings()).under(of_port)


@dataclass
class Document:
    """Nested tables, and where each came from."""

    data: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None
    text: str = ""
    overrides: list[tuple[Key, str]] = field(default_factory=list)

    def place(self, key: Key) -> str:
        """`etc/config.toml:12`, or the `--set` that gave it."""
        for given, origin in reversed(self.overrides):
            if given == key[: len(given)] or key == given[: len(key)]:
                return origin
        return f"{self.path}:{_line_of(self.text, key)}" if self.path else "configuration"


def read(path: Path) -> Document:
    """A TOML file. Raises ConfigurationError with the place if it is none."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        return Document(tomllib.loads(text), path, text)
    except OSError as exc:
        raise ConfigurationError(f"{path}: cannot be read: {exc.strerror}") from exc
    except UnicodeDecodeError as exc:
        raise ConfigurationError(f"{path}: is not UTF-8 text") from exc
    except tomllib.TOMLDecodeError as exc:
        found = re.search(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", str(exc))
        message, line, column = found.groups() if found else (str(exc), None, None)
        at = f":{line}:{column}" if line else f":{text.count(chr(10)) + 1}"
        raise ConfigurationError(f"{path}{at}: {message[:1].lower()}{message[1:]}") from exc


def is_assignment(text: str) -> bool:
    """Whether a text is written as `key=value`; what the key means is not looked at."""
    name, equals, _ = text.partition("=")
    return bool(equals) and all(map(_KEY.fullmatch, name.strip().split(".")))


def override(document: Document, assignment: str) -> None:
    """Apply `key=value`; the value is TOML, or else a plain string. Raises ConfigurationError."""
    name, equals, text = assignment.partition("=")
    if not equals or not name.strip():
        raise ConfigurationError(f"--set {assignment}: write it as key=value, as in params.max_speed=0.5")
    key = _parse_key(name.strip())
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    origin = f"--set {assignment}"
    _put(document.data, key, value, origin)
    document.overrides.append((key, origin))


def check(component: Component, document: Document, instance: str | None = None) -> Settings:
    """The settings in a document, for this component. Raises ConfigurationError with all that is wrong."""
    checker = _Checker(component)
    settings = checker.settings(document.data, instance or component.name.lower())
    if checker.complaints:
        lines = [f"{document.place(c.key)}: {c.message}" if c.key else c.message for c in checker.complaints]
        raise ConfigurationError("\n".join(lines))
    return settings


class _Checker:
    """Reads tables, and collects complaints instead of stopping."""

    def __init__(self, component: Component) -> None:
        self._component = component
        self.complaints: list[Complaint] = []

    def settings(self, data: Mapping[str, Any], instance: str) -> Settings:
        self._known(data, (), ("namespace", "middleware", "component", "params", "ports", "transports"))
        own = self._table(data, "component", ())
        self._known(own, ("component",), ("period", "log", "patience"))
        params, wrong = check_parameters(
            self._component.params or ParameterSet(self._component.name), self._table(data, "params", ())
        )
        self.complaints += [Complaint(("params", *c.key), c.message) for c in wrong]
        namespace = self._text(data, "namespace", ()) or ""
        if not names.is_namespace(namespace):
            self._complain(("namespace",), f"{namespace!r} is no namespace: letters, digits, `_`, `-`; parts with `/`")
        if not names.is_segment(instance):
            self._complain((), f"{instance!r} is no name for an instance: letters, digits, `_`, `-`")
        transports = self._table(data, "transports", ())
        self._known(transports, ("transports",), installed.transports())
        return Settings(
            instance=instance,
            namespace=namespace.strip("/"),
            middleware=self._text(data, "middleware", ()),
            period=self._seconds(own, "period", ("component",)) or self._component.period,
            log=self._choice(own, "log", ("component",), LOG_LEVELS) or "info",
            patience=self._seconds(own, "patience", ("component",)) or PATIENCE,
            params=params,
            ports=self._ports(self._table(data, "ports", ())),
            transports={name: self._table(transports, name, ("transports",)) for name in transports},
        )

    def _ports(self, data: Mapping[str, Any]) -> dict[tuple[str, ...], PortSettings]:
        known = {port.name: port for port in self._component.ports}
        found: dict[tuple[str, ...], PortSettings] = {}
        for name in data:
            if name not in known:
                self._complain(("ports", name), unknown("port", name, known))
                continue
            table = self._table(data, name, ("ports",))
            operations = [operation.name for operation, _ in known[name].interface.under(known[name].verb)]
            found[(name,)] = self._port(table, ("ports", name), operations)
            for operation in operations:
                if operation in table and operation not in _PORT_KEYS:
                    inner = self._table(table, operation, ("ports", name))
                    found[(name, operation)] = self._port(inner, ("ports", name, operation), ())
        return found

    def _port(self, table: Mapping[str, Any], at: Key, operations: Iterable[str]) -> PortSettings:
        self._known(table, at, (*_PORT_KEYS, *operations))
        source = self._text(table, "from", at)
        try:
            names.resolve(source or "", "", "X")
        except ValueError as exc:
            self._complain((*at, "from"), str(exc))
        return PortSettings(
            middleware=self._text(table, "middleware", at),
            source=source,
            deadline=self._seconds(table, "deadline", at),
            qos=self._qos(table["qos"], (*at, "qos")) if "qos" in table else None,
        )

    def _qos(self, given: Any, at: Key) -> QoS | None:
        if isinstance(given, str):
            if given not in PRESETS:
                self._complain(at, unknown("QoS preset", given, PRESETS))
            return PRESETS.get(given)
        if not isinstance(given, Mapping):
            self._complain(at, f"a QoS is a table or the name of a preset, not {given!r}")
            return None
        self._known(given, at, [f.name for f in fields(QoS)])
        values: dict[str, Any] = {}
        for name, kind in _QOS_WORDS.items():
            if word := self._choice(given, name, at, [str(member) for member in kind]):
                values[name] = kind(word)
        for name in ("deadline", "lifespan", "lease"):
            if name in given:
                values[name] = self._seconds(given, name, at)
        depth = given.get("depth", 10)
        if not isinstance(depth, int) or isinstance(depth, bool) or not 1 <= depth <= 1_000_000:
            self._complain((*at, "depth"), f"`depth` is {depth!r}; allowed: 1 to 1000000")
        else:
            values["depth"] = depth
        return QoS(**values)

    def _table(self, data: Mapping[str, Any], name: str, at: Key) -> Mapping[str, Any]:
        value = data.get(name, {})
        if isinstance(value, Mapping):
            return value
        self._complain((*at, name), f"`{name}` is a table, not {value!r}")
        return {}

    def _text(self, data: Mapping[str, Any], name: str, at: Key) -> str | None:
        value = data.get(name)
        if value is None or isinstance(value, str):
            return value
        self._complain((*at, name), f"`{name}` is a string, not {value!r}")
        return None

    def _seconds(self, data: Mapping[str, Any], name: str, at: Key) -> float | None:
        value = data.get(name)
        if value is None:
            return None
        if isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= MAX_SECONDS:
            return float(value)
        allowed = f"a positive number of seconds, at most {MAX_SECONDS:g}"
        self._complain((*at, name), f"`{name}` is {value!r}; allowed: {allowed}")
        return None

    def _choice(self, data: Mapping[str, Any], name: str, at: Key, allowed: Sequence[str]) -> str | None:
        value = data.get(name)
        if value is None or value in allowed:
            return value
        self._complain((*at, name), f"`{name}`: {unknown('value', str(value), allowed)}")
        return None

    def _known(self, data: Mapping[str, Any], at: Key, allowed: Iterable[str]) -> None:
        for name in data:
            if name not in allowed:
                self._complain((*at, name), unknown("key", name, allowed))

    def _complain(self, key: Key, message: str) -> None:
        self.complaints.append(Complaint(key, message))


_PORT_KEYS = ("middleware", "from", "deadline", "qos")
_QOS_WORDS: dict[str, type[Reliability | Durability | History | Liveliness]] = {
    "reliability": Reliability,
    "durability": Durability,
    "history": History,
    "liveliness": Liveliness,
}
_KEY = re.compile(r"([A-Za-z0-9_-]+)((?:\[\d+\])*)")


def _parse_key(text: str) -> Key:
    parts: list[str | int] = []
    for piece in text.split("."):
        found = _KEY.fullmatch(piece)
        if not found:
            raise ConfigurationError(f"--set {text}: `{piece}` is no key")
        parts.append(found[1])
        parts += [int(number) for number in re.findall(r"\d+", found[2])]
    return tuple(parts)


def _put(data: dict[str, Any], key: Key, value: Any, origin: str) -> None:
    table: Any = data
    for depth, part in enumerate(key):
        last = depth == len(key) - 1
        if isinstance(part, int):
            if not isinstance(table, list) or part >= len(table):
                raise ConfigurationError(f"{origin}: there is no item {dotted(key[: depth + 1])} to change")
        elif not isinstance(table, dict):
            raise ConfigurationError(f"{origin}: {dotted(key[:depth])} is no table")
        elif not last and part not in table:
            table[part] = {}
        if last:
            table[part] = value
        else:
            table = table[part]


def _line_of(text: str, key: Key) -> int:
    """The line of a TOML text at which a key stands, or the nearest table above it."""
    best, best_depth = 1, 0
    table: Key = ()
    counts: dict[Key, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if found := re.match(r"\s*\[\[\s*([^\]]+?)\s*\]\]", line):
            name = _names(found[1])
            counts[name] = counts.get(name, -1) + 1
            table = (*name, counts[name])
            here = table
        elif found := re.match(r"\s*\[\s*([^\]]+?)\s*\]", line):
            here = table = _names(found[1])
        elif found := re.match(r"""\s*([\w."'-]+)\s*=""", line):
            here = (*table, *_names(found[1]))
        else:
            continue
        shared = min(len(here), len(key))
        depth = shared if here[:shared] == key[:shared] else 0
        if depth > best_depth:
            best, best_depth = number, depth
    return best


def _names(text: str) -> tuple[str, ...]:
    return tuple(part.strip().strip("\"'") for part in text.split("."))
