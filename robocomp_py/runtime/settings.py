"""The configuration of a component: `etc/config.toml`, then its environment, then the command line.

    namespace = "robot1"             prefix of the names of its channels
    middleware = "zeromq"            middleware of all its ports; `auto`: chosen by rcdeploy for each link
    [component]
    period = 0.05                    seconds from one compute to the next
    log = "info"                     debug, info, warning or error
    startup_timeout = 60.0           seconds to wait for required components
    watchdog = 30.0                  longest call of its code in seconds, before its launcher ends it; 0: no limit
    diary = "wander.mcap"            file for all that enters its code, by which `rc rerun` runs it again
    [timers]
    poll = 0.02                      seconds from one call to the next of a timer that its CDSL declares
    [clock]
    leader = "world"                 the instance whose clock it follows; its own name for the leader
    followers = ["camera", "wander"] for the leader: the instances for which it waits
    speed = 1.0                      for the leader: seconds of this clock in one second; 0: as fast as possible
    mode = "lockstep"                or `free`: the clock passes by itself, and waits for no component
    lost = "keep"                    for the leader: whether to `keep` on or `stop` when a follower is gone
    [params]                         the parameters that its PDSL declares
    [ports.laser]                    a proxy, or a handler's prefix
    from = "world"                   the instance to use; also `world/Laser1` and `/robot2/world/Laser`
    middleware = "zeromq"
    deadline = 0.5                   longest duration of a call in seconds
    qos = { reliability = "reliable", depth = 1 }     or a preset: "sensor_data"
    also = ["shm"]                   further middlewares of a provided port; further publishers of a subscription:
                                     [{ from = "camera2", middleware = "shm" }]
    [ports.laser.getLaserData]       the same for one operation
    [offers.front.Laser]             a named instance, with settings as those of a port; if there is a table `offers`,
                                     the component adds no other names
    [transports.zeromq]              options of a transport

    ROBOCOMP__COMPONENT__PERIOD=0.05         in the environment: the same keys, parts separated by `__`
    --set component.period=0.05              on the command line
    --set max_speed=1.5                      `params.` may be omitted

Plug-ins read files in foreign formats: see `plugins`.

Everything is checked before anything is opened. One error reports all mistakes, with their places.
"""

from __future__ import annotations

import re
import tomllib
from collections import ChainMap
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from .. import installed, plugins
from ..contract.component import MAX_SECONDS, Component, Port
from ..contract.interface import Verb
from ..contract.middleware import carrier
from ..contract.parameters import Complaint, Key, Parameter, ParameterKind, ParameterSet
from ..contract.parameters import check as check_parameters
from ..contract.qos import DEFAULT_QOS, DEPTHS, PRESETS, TIMES, WORDS, QoS
from ..errors import ConfigurationError
from ..spelling import unknown
from ..wire import names
from .document import Document as Document
from .document import Renamed, has_sections, parsed, put
from .keys import (
    CLOCK_KEYS,
    COMPONENT_KEYS,
    KEYS,
    OLDER_NAMES,
    PORT_KEYS,
    PREFIX,
    means_parameter,
    parse_key,
    put_into,
    spelled,
)

DEADLINE = 5.0
"""Default of the longest duration of a call, in seconds."""

STARTUP_TIMEOUT = 60.0
"""Seconds that a starting component waits for required components, unless its configuration says otherwise."""

LOG_LEVELS = ("debug", "info", "warning", "error")

VARIABLE = "environment variable "
"""Stands before the name of such a variable where it is named as the origin of a value."""


@dataclass(frozen=True)
class Way:
    """A further route of a port: another middleware or, for a subscription, another publisher. None: as the port."""

    middleware: str | None = None
    source: str | None = None


@dataclass(frozen=True)
class PortSettings:
    """The settings of a port or of one of its operations; None stands for the setting of the level above."""

    middleware: str | None = None
    source: str | None = None
    """`from` in the file: the instance whose channels are used."""
    deadline: float | None = None
    qos: QoS | None = None
    also: tuple[Way, ...] | None = None

    def under(self, above: PortSettings) -> PortSettings:
        """These settings, completed by those of the level above."""
        return PortSettings(
            above.middleware if self.middleware is None else self.middleware,
            above.source if self.source is None else self.source,
            above.deadline if self.deadline is None else self.deadline,
            above.qos if self.qos is None else self.qos,
            above.also if self.also is None else self.also,
        )


@dataclass(frozen=True)
class ClockSettings:
    """How a component follows the clock of another one, or leads."""

    leader: str
    followers: tuple[str, ...] = ()
    speed: float = 1.0
    """Of the clock's seconds in one second; 0 for as fast as possible."""
    lost: str = "keep"
    mode: str = "lockstep"
    """Or `free`: the clock passes by itself, and waits for no component."""


@dataclass(frozen=True)
class Settings:
    """A checked configuration."""

    instance: str
    namespace: str = ""
    middleware: str | None = None
    period: float = 0.1
    log: str = "info"
    startup_timeout: float = STARTUP_TIMEOUT
    watchdog: float | None = None
    """Seconds; 0 for no limit, None for the launcher's choice."""
    diary: str = ""
    """The file for its diary; "" for none."""
    timers: Mapping[str, float] = field(default_factory=dict)
    """Periods in seconds, of the timers that the component declares."""
    clock: ClockSettings | None = None
    """None for the machine's clock."""
    params: Mapping[str, Any] = field(default_factory=dict)
    ports: Mapping[tuple[str, ...], PortSettings] = field(default_factory=dict)
    """Keys are (port,) and (port, operation)."""
    offers: Mapping[str, Mapping[tuple[str, ...], PortSettings]] | None = None
    """The same for each named instance, of the ports that it provides; None if any name may be added."""
    transports: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    document: Document | None = field(default=None, compare=False, repr=False)
    """The document that these settings were read from."""
    _effective: dict[tuple[int, str, str], tuple[Port, PortSettings]] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )
    """What `port` has returned. The plan of a large network asks for the same again and again."""

    def middlewares(self, port: Port, operation: str, generated_for: str) -> list[str]:
        """The middlewares of an operation of a port, the main one first."""
        chosen = self.port(port, operation)
        first = carrier(chosen.middleware, generated_for)
        return [first, *(carrier(way.middleware or first, generated_for) for way in chosen.also or ())]

    def port(self, port: Port, operation: str, instance: str = "") -> PortSettings:
        """The effective settings of one operation of a port, or of a named instance of it."""
        key = id(port), operation, instance
        if key not in self._effective:
            self._effective[key] = port, self._port(port, operation, instance)  # the port is kept, and so is its id
        return self._effective[key][1]

    def _port(self, port: Port, operation: str, instance: str) -> PortSettings:
        base = PortSettings(port.middleware or self.middleware, "", DEADLINE, port.qos)
        offered = (self.offers or {}).get(instance, {})
        for table in (self.ports, offered) if offered else (self.ports,):
            for key in ((port.name,), (port.name, operation)):
                if key in table:
                    base = table[key].under(base)
        return base

    def of(self, instance: str) -> Settings:
        """The settings of a named instance, as those of a component that provides its ports by its own name."""
        ports = dict(self.ports)
        offered = (self.offers or {}).get(instance, {})
        for key, chosen in sorted(offered.items(), key=lambda each: len(each[0])):
            for each in {key, *(known for known in ports if known[: len(key)] == key)}:
                ports[each] = chosen.under(ports.get(each, PortSettings()))
        return replace(self, instance=instance, ports=ports, offers=None)

    def offered(self, port: Port) -> frozenset[str] | None:
        """The names of the instances that may provide a port; None if all may."""
        if self.offers is None:
            return None
        return frozenset(name for name, tables in self.offers.items() if (port.name,) in tables)

    def peer_of(self, port: Port) -> str:
        """The peer that a port uses, for messages: the configured proxy if there is one, else the instance."""
        source = self.port(port, "").source
        proxies = ChainMap(*(options.get("proxies", {}) for options in self.transports.values()))
        return str(proxies.get(source, source)) if source else "any instance"


def middlewares(settings: Settings) -> dict[Key, str]:
    """Every middleware named in the settings, by its key."""
    named: dict[Key, str | None] = {("middleware",): settings.middleware}
    for key, port in settings.ports.items():
        named["ports", *key, "middleware"] = port.middleware
        for number, way in enumerate(port.also or ()):
            named["ports", *key, "also", number] = way.middleware
    return {key: each for key, name in named.items() if (each := carrier(name, ""))}


def find(folder: Path) -> Path | None:
    """The configuration file in a component's folder: `etc/config.toml`, or a file that a plug-in finds.

    Plug-ins are skipped if the component is ours and has an `etc/config.toml`, and if `etc` is empty.
    """
    own = folder / "etc" / "config.toml"
    others = own.parent.is_dir() and any(own.parent.iterdir())
    if others and not (own.exists() and plugins.is_ours(folder)):
        for reader in plugins.configuration_readers():
            if found := reader.find(folder):
                return found
    return own if own.exists() else None


def read(path: Path, params: ParameterSet | None = None, topics: Collection[str] = ()) -> Document:
    """Read a configuration file, in TOML or in a format that a plug-in reads.

    `params` are the component's parameters, and `topics` the interfaces it publishes and subscribes to: plug-ins need
    both. Raises ConfigurationError with the place of a mistake.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as exc:
        raise ConfigurationError(f"{path}: cannot be read: {exc.strerror}") from exc
    except UnicodeDecodeError as exc:
        if path.suffix == ".toml":
            raise ConfigurationError(f"{path}: is not UTF-8 text") from exc
        text = path.read_text(encoding="latin-1")  # comments of old files
    return from_text(text, path, params, topics)


def read_for(path: Path, component: Component) -> Document:
    """Read a configuration file for a known component."""
    return read(path, component.params, component.topics)


def from_text(text: str, path: Path, params: ParameterSet | None = None, topics: Collection[str] = ()) -> Document:
    """Read a configuration from its text; see `read`."""
    data = _as_toml(text, path)
    if data is not None and data.keys() <= set(KEYS):
        return Document(data, path, text, params=params)
    for reader in plugins.configuration_readers():
        if reader.accepts(path, text):
            return reader.read(text, path, params or ParameterSet(""), topics)
    if data is None:
        raise ConfigurationError(f"{path}: not valid TOML, and no installed package reads this format")
    return Document(data, path, text, params=params)


def _as_toml(text: str, path: Path) -> dict[str, Any] | None:
    """The tables of a TOML text; None for another format. Raises NotToml if it was meant to be TOML."""
    if path.suffix == ".toml" or has_sections(text):
        return parsed(text, path)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None
    return data if data.keys() <= set(KEYS) else None


def override(document: Document, assignment: str, origin: str = "") -> None:
    """Apply `key=value`. A value that is not TOML is a plain string. Raises ConfigurationError.

    `origin` names the source of the value in messages; by default `--set`.
    """
    name, equals, text = assignment.partition("=")
    if not equals or not name.strip():
        raise ConfigurationError(f"--set {assignment}: not key=value, as in params.max_speed=0.5")
    key = parse_key(name.strip())
    if key[0] not in KEYS and document.params and means_parameter(str(key[0]), document.params):
        key = ("params", *key)
    _set(document, key, text.strip(), origin or f"--set {assignment}")


def environment(document: Document, component: Component, variables: Mapping[str, str]) -> None:
    """Apply the environment variables that begin with `ROBOCOMP__`. Raises ConfigurationError.

    `__` separates the parts of a key. Upper and lower case are equal: `ROBOCOMP__PARAMS__MOTORS__0__MAX_SPEED=1.5`.
    """
    for name in sorted((each for each in variables if each.upper().startswith(PREFIX)), key=_by_number):
        origin = f"{VARIABLE}{name}"
        try:
            key = spelled(component, name[len(PREFIX) :].split("__"))
        except ValueError as exc:
            raise ConfigurationError(f"{origin}: {exc}") from exc
        _set(document, key, variables[name].strip(), origin)


def _by_number(name: str) -> list[str | int]:
    """A sort key that orders names by the numbers in them, because items of lists are added in order."""
    parts = re.split(r"([0-9]{1,9})", name.upper())
    return [int(part) if position % 2 else part for position, part in enumerate(parts)]


def _set(document: Document, key: Key, text: str, origin: str) -> None:
    if key in OLDER_NAMES:
        document.renamed += (Renamed(key, OLDER_NAMES[key], origin),)
        key = OLDER_NAMES[key]
    parameter = _parameter(document.params, key[1:]) if document.params and key[0] == "params" else None
    try:
        read = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):  # not TOML, or a number or a nesting that Python cannot read
        read = {}
    is_toml = read.keys() == {"value"}  # more keys: a text of several lines
    value = read["value"] if is_toml else parameter.read(text) if parameter else text
    if parameter and parameter.kind in (ParameterKind.STRING, ParameterKind.ENUM) and not isinstance(value, str):
        value = text  # a string may look like a number
    put_into(document.data, key, value, origin)
    if value != {}:
        document.overrides.append((key, origin))


def settle(document: Document, component: Component, generated_for: str) -> None:
    """Add the settings of ports that depend on all others. Call it once, when everything is set, before `check`."""
    _accept_older_names(document)
    if document.complete:
        document.complete(document, component, generated_for)
    transports = document.data.get("transports")
    for name, options in transports.items() if isinstance(transports, Mapping) else ():
        if isinstance(options, Mapping):
            _complete(document, component, generated_for, name, options)


def _accept_older_names(document: Document) -> None:
    """Move the values that a file gives under older names; a value under the present name holds."""
    for written, key in OLDER_NAMES.items():
        table = document.data.get(str(written[0]))
        if isinstance(table, dict) and written[-1] in table:
            document.renamed += (Renamed(written, key),)
            table.setdefault(str(key[-1]), table.pop(str(written[-1])))


def _complete(
    document: Document, component: Component, generated_for: str, name: str, options: Mapping[str, Any]
) -> None:
    """Add the settings of ports that follow from the options of a transport."""
    from ..transports.deployment import (  # only a component with such a table needs these
        Completion,
        Incomplete,
        deployment_of,
    )
    from .commonbehavior import port_of

    is_overridden = any(key[0] == "ports" and key[-1] == "from" for key, _ in document.overrides)
    of = Incomplete(
        component, port_of(component), lambda: examine(component, document)[0], generated_for, is_overridden
    )
    for each in list(deployment_of(name).complete(options, of)):
        if isinstance(each, Completion):
            put(document.data, each.key, each.value)
            document.overrides.append((each.key, document.place(each.said_by)))
        else:
            document.complaints = (*document.complaints, each)


def _parameter(params: ParameterSet, key: Key) -> Parameter | None:
    """The parameter at a key below `params`."""
    match key:
        case (str(name),):
            return next((each for each in params.parameters if each.name == name), None)
        case (str(name), int(), *rest):
            return next((_parameter(each.items, tuple(rest)) for each in params.lists if each.name == name), None)
    return None


def check(component: Component, document: Document, instance: str | None = None) -> Settings:
    """The settings in a document, for this component. Raises ConfigurationError with all mistakes."""
    settings, complaints = examine(component, document, instance)
    if complaints:
        lines = [f"{document.place(c.key)}: {c.message}" if c.key else c.message for c in complaints]
        raise ConfigurationError("\n".join(lines))
    return replace(settings, document=document)


def examine(component: Component, document: Document, instance: str | None = None) -> tuple[Settings, list[Complaint]]:
    """The settings in a document, for this component, and all mistakes in them."""
    checker = _Checker(component)
    settings = checker.settings(document.data, instance or component.name.lower())
    told = [each.key for each in document.complaints]
    complaints = [*document.complaints, *(each for each in checker.complaints if each.key not in told)]
    if document.passed_on:
        complaints = [each for each in complaints if each.key[:1] != ("params",)]
    return settings, complaints


class _Checker:
    """Reads tables, and collects complaints instead of stopping."""

    def __init__(self, component: Component) -> None:
        self._component = component
        self.complaints: list[Complaint] = []

    def settings(self, data: Mapping[str, Any], instance: str) -> Settings:
        self._known(data, (), KEYS)
        own = self._table(data, "component", ())
        self._known(own, ("component",), COMPONENT_KEYS)
        params, wrong = check_parameters(
            self._component.params or ParameterSet(self._component.name), self._table(data, "params", ())
        )
        if isinstance(data.get("params", {}), Mapping):  # otherwise the table as a whole has been reported
            self.complaints += [Complaint(("params", *c.key), c.message, c.code) for c in wrong]
        namespace = self._text(data, "namespace", ()) or ""
        if not names.is_namespace(namespace):
            message = f"{namespace!r} is not a namespace; allowed: letters, digits, `_`, `-`, and `/` between parts"
            self._complain("config-bad-name", ("namespace",), message)
        if not names.is_segment(instance):
            message = f"{instance!r} is not a name for an instance; allowed: letters, digits, `_`, `-`"
            self._complain("config-bad-name", (), message)
        transports = self._table(data, "transports", ())
        self._known(transports, ("transports",), installed.transports())
        tables = {name: self._table(transports, name, ("transports",)) for name in transports}
        for name, options in tables.items():
            self._check_options(name, options)
        return Settings(
            instance=instance,
            namespace=namespace.strip("/"),
            middleware=self._text(data, "middleware", ()),
            period=self._seconds(own, "period", ("component",)) or self._component.period,
            log=self._choice(own, "log", ("component",), LOG_LEVELS) or "info",
            startup_timeout=self._seconds(own, "startup_timeout", ("component",)) or STARTUP_TIMEOUT,
            watchdog=0.0 if own.get("watchdog") == 0 else self._seconds(own, "watchdog", ("component",)),
            diary=self._text(own, "diary", ("component",)) or "",
            timers=self._timers(self._table(data, "timers", ())),
            clock=self._clock(self._table(data, "clock", ())) if "clock" in data else None,
            params=params,
            ports=self._ports(self._table(data, "ports", ()), {port.name: port for port in self._component.ports}),
            offers=self._offers(self._table(data, "offers", ())) if "offers" in data else None,
            transports=tables,
        )

    def _offers(self, data: Mapping[str, Any]) -> dict[str, dict[tuple[str, ...], PortSettings]]:
        known = {port.name: port for port in self._component.named}
        found = {}
        for name in data:
            if not names.is_segment(name):
                message = f"{name!r} is not a name for an instance; allowed: letters, digits, `_`, `-`"
                self._complain("config-bad-name", ("offers", name), message)
            found[name] = self._ports(self._table(data, name, ("offers",)), known, ("offers", name))
        return found

    def _timers(self, data: Mapping[str, Any]) -> dict[str, float]:
        declared = {each.name: each.period for each in self._component.timers}
        for name in data:
            if name not in declared:
                self._complain("config-unknown-key", ("timers", name), unknown("timer", name, declared))
        return {name: self._seconds(data, name, ("timers",)) or period for name, period in declared.items()}

    def _clock(self, data: Mapping[str, Any]) -> ClockSettings | None:
        at = ("clock",)
        self._known(data, at, CLOCK_KEYS)
        followers = data.get("followers", [])
        if not isinstance(followers, list) or not all(isinstance(each, str) for each in followers):
            message = f'`followers` must be a list of instances, as in ["camera"], not {followers!r}'
            self._complain("config-wrong-type", (*at, "followers"), message)
            followers = []
        every = [(self._text(data, "leader", at), "leader"), *((each, "followers") for each in followers)]
        for name, key in every:
            if name and not names.is_namespace(name):
                message = f"{name!r} names no instance; write `instance` or `/namespace/instance`"
                self._complain("config-bad-name", (*at, key), message)
        speed = 0.0 if data.get("speed") == 0 else self._seconds(data, "speed", at) or ClockSettings.speed
        lost = self._choice(data, "lost", at, ("keep", "stop")) or ClockSettings.lost
        leader = every[0][0]
        if not leader:
            self._complain("config-missing", at, "`clock` lacks its `leader`, the instance whose clock is followed")
            return None
        mode = self._choice(data, "mode", at, ("lockstep", "free")) or ClockSettings.mode
        if mode == "free" and not speed:
            message = "`speed` is 0, as fast as possible, which a clock can only be in lock-step"
            self._complain("config-out-of-range", (*at, "speed"), message)
        return ClockSettings(leader, tuple(followers), speed, lost, mode)

    def _ports(
        self, data: Mapping[str, Any], known: Mapping[str, Port], at: Key = ("ports",)
    ) -> dict[tuple[str, ...], PortSettings]:
        found: dict[tuple[str, ...], PortSettings] = {}
        for name in data:
            if name not in known:
                self._complain("config-unknown-key", (*at, name), unknown("port", name, known))
                continue
            table = self._table(data, name, at)
            operations = known[name].interface.called(known[name].verb)
            found[(name,)] = self._port(known[name], table, (*at, name), operations)
            for operation in operations:
                if operation in table and operation not in PORT_KEYS:
                    inner = self._table(table, operation, (*at, name))
                    found[(name, operation)] = self._port(known[name], inner, (*at, name, operation), ())
        return found

    def _port(self, port: Port, table: Mapping[str, Any], at: Key, operations: Iterable[str]) -> PortSettings:
        self._known(table, at, (*PORT_KEYS, *operations))
        return PortSettings(
            middleware=self._text(table, "middleware", at),
            source=self._source(table, at),
            also=self._ways(port, table, at),
            deadline=self._seconds(table, "deadline", at),
            qos=self._qos(table["qos"], (*at, "qos")) if "qos" in table else None,
        )

    def _source(self, table: Mapping[str, Any], at: Key) -> str | None:
        source = self._text(table, "from", at)
        try:
            names.resolve(source or "", "", "X")
        except ValueError as exc:
            self._complain("config-bad-name", (*at, "from"), str(exc))
        return source

    def _ways(self, port: Port, table: Mapping[str, Any], at: Key) -> tuple[Way, ...] | None:
        if "also" not in table:
            return None
        given, key = table["also"], (*at, "also")
        if port.verb is Verb.REQUIRES:
            message = "`also` has no meaning for a required interface, which has one server"
            self._complain("config-unknown-key", key, message)
            return None
        if not isinstance(given, list):
            message = f'`also` must be a list of middlewares, as in ["shm"], not {given!r}'
            self._complain("config-wrong-type", key, message)
            return None
        return tuple(self._way(port, each, (*key, number)) for number, each in enumerate(given))

    def _way(self, port: Port, given: Any, at: Key) -> Way:
        if isinstance(given, str):
            return Way(given)
        if not isinstance(given, Mapping):
            self._complain("config-wrong-type", at, f"an item must be a middleware or a table, not {given!r}")
            return Way()
        self._known(given, at, ("middleware", "from") if port.verb is Verb.SUBSCRIBES else ("middleware",))
        return Way(self._text(given, "middleware", at), self._source(given, at))

    def _qos(self, given: Any, at: Key) -> QoS | None:
        if isinstance(given, str):
            if given not in PRESETS:
                self._complain("config-unknown-value", at, unknown("QoS preset", given, PRESETS))
            return PRESETS.get(given)
        if not isinstance(given, Mapping):
            self._complain("config-wrong-type", at, f"`qos` must be a table or the name of a preset, not {given!r}")
            return None
        self._known(given, at, [f.name for f in fields(QoS)])
        values: dict[str, Any] = {}
        for name, kind in WORDS.items():
            if word := self._choice(given, name, at, [str(member) for member in kind]):
                values[name] = kind(word)
        for name in TIMES:
            if name in given:
                values[name] = self._seconds(given, name, at)
        depth = given.get("depth", DEFAULT_QOS.depth)
        if not isinstance(depth, int) or isinstance(depth, bool) or depth not in DEPTHS:
            message = f"`depth` is {depth!r}; allowed: {DEPTHS[0]} to {DEPTHS[-1]}"
            self._complain("config-out-of-range", (*at, "depth"), message)
        else:
            values["depth"] = depth
        return QoS(**values)

    def _check_options(self, name: str, options: Mapping[str, Any]) -> None:
        from ..transports.deployment import deployment_of  # only a component with such a table needs it

        for each in deployment_of(name).examine(options):
            self._complain(each.code, ("transports", name, *each.key), each.message)

    def _table(self, data: Mapping[str, Any], name: str, at: Key) -> Mapping[str, Any]:
        value = data.get(name, {})
        if isinstance(value, Mapping):
            return value
        self._complain("config-wrong-type", (*at, name), f"`{name}` must be a table, not {value!r}")
        return {}

    def _text(self, data: Mapping[str, Any], name: str, at: Key) -> str | None:
        value = data.get(name)
        if value is None or isinstance(value, str):
            return value
        self._complain("config-wrong-type", (*at, name), f"`{name}` must be a string, not {value!r}")
        return None

    def _seconds(self, data: Mapping[str, Any], name: str, at: Key) -> float | None:
        value = data.get(name)
        if value is None:
            return None
        if isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= MAX_SECONDS:
            return float(value)
        allowed = f"a positive number of seconds, at most {MAX_SECONDS:g}"
        self._complain("config-out-of-range", (*at, name), f"`{name}` is {value!r}; allowed: {allowed}")
        return None

    def _choice(self, data: Mapping[str, Any], name: str, at: Key, allowed: Sequence[str]) -> str | None:
        value = data.get(name)
        if value is None or value in allowed:
            return value
        self._complain("config-unknown-value", (*at, name), f"`{name}`: {unknown('value', str(value), allowed)}")
        return None

    def _known(self, data: Mapping[str, Any], at: Key, allowed: Iterable[str]) -> None:
        for name in data:
            if name not in allowed:
                self._complain("config-unknown-key", (*at, name), unknown("key", name, allowed))

    def _complain(self, code: str, key: Key, message: str) -> None:
        self.complaints.append(Complaint(key, message, code))
