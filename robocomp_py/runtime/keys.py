"""The keys of a configuration, as `--set` and environment variables spell them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from .. import installed
from ..contract.component import Component
from ..contract.parameters import Key, ParameterSet, dotted
from ..contract.qos import QoS
from ..errors import ConfigurationError
from ..spelling import closest

PREFIX = "ROBOCOMP__"
"""Prefix of the environment variables that set keys."""

KEYS = ("namespace", "middleware", "component", "timers", "clock", "params", "ports", "offers", "transports")

COMPONENT_KEYS = ("period", "log", "startup_timeout", "watchdog", "diary")
CLOCK_KEYS = ("leader", "followers", "speed", "lost", "mode")
OLDER_NAMES: Mapping[Key, Key] = {("component", "patience"): ("component", "startup_timeout")}
"""Keys of earlier versions, which are still accepted with a warning."""
PORT_KEYS = ("middleware", "from", "deadline", "qos", "also")
_KEY = re.compile(r'([A-Za-z0-9_-]+|"[^".=]+")((?:\[\d+\])*)')


def is_assignment(text: str) -> bool:
    """Whether a text has the form `key=value`. The key may be unknown."""
    name, equals, _ = text.partition("=")
    return bool(equals) and all(map(_KEY.fullmatch, name.strip().split(".")))


def parse_key(text: str) -> Key:
    parts: list[str | int] = []
    for piece in text.split("."):
        found = _KEY.fullmatch(piece)
        if not found:
            raise ConfigurationError(f"--set {text}: `{piece}` is not a valid key")
        parts.append(found[1].strip('"'))
        parts += [int(number) for number in re.findall(r"\d+", found[2])]
    return tuple(parts)


def spelled(component: Component, parts: Sequence[str]) -> Key:
    """The key with these parts, whatever their case. Raises ValueError if two keys match."""
    known = _keys_of(component)
    if not _spellings(parts[0], known) and component.params and means_parameter(parts[0].lower(), component.params):
        parts = ["params", *parts]
    key: Key = ()
    for part in parts:
        if not part:
            raise ValueError(f"a part of the key is empty; write it as in {PREFIX}COMPONENT__PERIOD")
        if part.isdecimal() and _ITEM in known:
            key, known = (*key, int(part)), known[_ITEM]
            continue
        found = _spellings(part, known)
        if len(found) > 1:
            raise ValueError(f"`{part}` is ambiguous: write it exactly as {' or '.join(f'`{each}`' for each in found)}")
        name = found[0] if found else part.lower()
        key, known = (*key, name), known.get(name, {})
    return key


_Keys = Mapping[str, "_Keys"]
_ITEM = "[]"
"""Stands for any item of a list."""


def _keys_of(component: Component) -> _Keys:
    """All keys of a component's configuration, as nested tables."""
    port = {**_words(PORT_KEYS), "qos": _words(f.name for f in fields(QoS))}
    ports = {each.name: dict.fromkeys(each.interface.called(each.verb), port) | port for each in component.ports}
    return {
        **_words(KEYS),
        "component": _words(COMPONENT_KEYS),
        "timers": _words(each.name for each in component.timers),
        "clock": _words(CLOCK_KEYS),
        "params": _keys_of_params(component.params) if component.params else {},
        "ports": ports,
        "offers": {},
        "transports": _words(installed.transports()),
    }


def _words(names: Iterable[str]) -> dict[str, _Keys]:
    """Keys that are not tables."""
    return {name: {} for name in names}


def _keys_of_params(params: ParameterSet) -> _Keys:
    lists = {each.name: {_ITEM: _keys_of_params(each.items)} for each in params.lists}
    return {each.name: {} for each in params.parameters} | lists


def _spellings(name: str, known: Iterable[str]) -> list[str]:
    """The known names that equal a name except for case; only the name itself if it is known."""
    return [name] if name in known else [each for each in known if each.lower() == name.lower()]


def put_into(data: dict[str, Any], key: Key, value: Any, origin: str) -> None:
    """Set a key, creating missing tables, and the next item of a list if its number is given."""
    table: Any = data
    for depth, part in enumerate(key):
        inner: Any = value if depth == len(key) - 1 else [] if isinstance(key[depth + 1], int) else {}
        if isinstance(part, int):
            if not isinstance(table, list) or part > len(table):
                raise ConfigurationError(f"{origin}: there is no item {dotted(key[: depth + 1])}")
            if part == len(table):
                table.append(inner)
        elif not isinstance(table, dict):
            raise ConfigurationError(f"{origin}: {dotted(key[:depth])} is not a table")
        elif part not in table:
            table[part] = inner
        if depth == len(key) - 1 and (value != {} or not isinstance(table[part], dict)):  # {} adds nothing to a table
            table[part] = value
        table = table[part]


def means_parameter(name: str, params: ParameterSet) -> bool:
    """Whether an unknown first part of a key is the name of a parameter, possibly misspelled."""
    names = [*(each.name for each in params.parameters), *(each.name for each in params.lists)]
    near = closest(name, [*KEYS, *names])
    return name in names or (near in names and near not in KEYS)
