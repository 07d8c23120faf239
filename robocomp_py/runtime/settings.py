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
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from .. import plugins
from ..contract.component import Component
from ..contract.middleware import carrier
from ..contract.parameters import Complaint, Key, Parameter, ParameterKind, ParameterSet
from ..errors import ConfigurationError
from .checked import DEADLINE as DEADLINE
from .checked import STARTUP_TIMEOUT as STARTUP_TIMEOUT
from .checked import ClockSettings as ClockSettings
from .checked import PortSettings as PortSettings
from .checked import Settings as Settings
from .checked import Way as Way
from .checker import LOG_LEVELS as LOG_LEVELS
from .checker import Checker
from .document import Document as Document
from .document import Renamed, has_sections, parsed, put
from .keys import KEYS, OLDER_NAMES, PREFIX, means_parameter, parse_key, put_into, spelled

VARIABLE = "environment variable "
"""Stands before the name of such a variable where it is named as the origin of a value."""


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
    checker = Checker(component)
    settings = checker.settings(document.data, instance or component.name.lower())
    told = [each.key for each in document.complaints]
    complaints = [*document.complaints, *(each for each in checker.complaints if each.key not in told)]
    if document.passed_on:
        complaints = [each for each in complaints if each.key[:1] != ("params",)]
    return settings, complaints
