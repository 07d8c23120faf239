"""Parameters of running components, and the files that ROS 2 keeps them in.

Values are read by `Introspection` with their ranges, or by `CommonBehavior` alone if a component has no more; they are
set by `CommonBehavior`, which refuses all values of a change if one is wrong.

    /robot1/wander:
      ros__parameters:
        max_speed: 0.5
        motors[0]:
          limit: 3
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

import yaml

from ..errors import ConfigurationError, RemoteFailure
from ..printable import printable
from ..runtime.RoboCompIntrospection import Setting
from . import asking
from .access import Access
from .network import Channel, Network

COMMON = "CommonBehavior"

LONGEST_FILE = 1_000_000
"""Octets of a file of parameters."""

_DEPTH = 16
_MOST = 10_000
"""Parameters in one file."""

_KEY = "ros__parameters"


def components(network: Network) -> list[str]:
    """The whole names of all components that have parameters, or may have."""
    return network.offering(COMMON, ["getParameterList", "setParameterList"])


def read(access: Access, network: Network, component: str, deadline: float) -> list[Setting]:
    """All parameters of a component. Raises what a call raises, and ValueError if the component is not there."""
    if told := asking.describe(access, network, component, deadline):
        return told.settings
    (found,) = access.ask(_common(network, component, "getParameterList"), (), deadline)
    return [
        Setting(name=str(name), type=str(kind), value=printable(value), editable=bool(editable))
        for name, (editable, value, kind) in sorted(found.items())
    ]


def change(access: Access, network: Network, component: str, texts: Mapping[str, str], deadline: float) -> None:
    """Set parameters, all or none. Raises ValueError with the reason of a component that refuses, and what a call
    raises."""
    given = {name: (True, text, "") for name, text in texts.items()}
    try:
        access.ask(_common(network, component, "setParameterList"), (given,), deadline)
    except RemoteFailure as exc:
        if exc.kind != ConfigurationError.__name__:
            raise
        raise ValueError(f"{component}: {printable(exc.reason)}") from exc


def _common(network: Network, component: str, operation: str) -> Channel:
    wanted = f"{component}/{COMMON}/{operation}"
    found = next((each for each in network.stock(COMMON) if each.name == wanted and each.providers), None)
    if found is None:
        raise ValueError(f"{component} does not implement {COMMON}")
    return found


def allowed(setting: Setting) -> str:
    """What may be written, for people: `float, 0.0 to 2.0`."""
    if setting.choices:
        return f"one of {', '.join(setting.choices)}"
    return f"{setting.type}, {setting.minimum} to {setting.maximum}" if setting.minimum else setting.type


def plain(setting: Setting) -> dict[str, Any]:
    """All that is known of it, as in JSON. Without a range, `minimum` and `maximum` are ""."""
    values = {name: _typed(setting.type, getattr(setting, name)) for name in ("value", "initial", "minimum", "maximum")}
    return asdict(setting) | values


def typed(setting: Setting) -> Any:
    """Its value as in JSON and YAML; the text itself if it is not a value of its type."""
    return _typed(setting.type, setting.value)


def _typed(kind: str, text: str) -> Any:
    try:
        match kind:
            case "int":
                return int(text)
            case "float":
                return float(text)
            case "bool":
                return {"true": True, "false": False}[text.lower()]
    except (ValueError, KeyError):
        pass
    return text


# Files of ROS 2.


def to_yaml(every: Mapping[str, Iterable[Setting]]) -> str:
    """A file with the parameters of components, by their whole names."""
    document: dict[str, Any] = {}
    for component, settings in every.items():
        inside: dict[str, Any] = {}
        for each in settings:
            *above, last = each.name.split(".")
            scope = inside
            for part in above:
                scope = scope.setdefault(part, {})
            scope[last] = typed(each)
        document[f"/{component}"] = {_KEY: inside}
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True, default_flow_style=False)


def from_yaml(text: str, component: str) -> dict[str, str]:
    """The parameters that a file has for a component, as texts by name: of its own node, and of `/**`.

    Raises ValueError, which says what is wrong.
    """
    try:
        document = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError) as exc:
        raise ValueError(f"no YAML: {' '.join(str(exc).split())}") from exc
    nodes = dict(_nodes(document, "", 0))
    if not nodes:
        raise ValueError(f"it has no `{_KEY}`")
    found: dict[str, str] = {}
    meant = [each for each in nodes if _matches(each, component)]
    if not meant:
        raise ValueError(f"it has parameters of {', '.join(sorted(nodes))}, but none of /{component}")
    for node in sorted(meant, key=len):  # what names the whole node comes last
        found.update(_flat(nodes[node], "", 0))
        if len(found) > _MOST:
            raise ValueError(f"more than {_MOST} parameters")
    return found


def _nodes(value: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, dict) or depth > _DEPTH:
        return
    for key, inner in value.items():
        if key == _KEY:
            yield name or "/**", inner
        else:
            yield from _nodes(inner, f"{name}/{str(key).strip('/')}", depth + 1)


def _matches(node: str, component: str) -> bool:
    pattern = re.escape(node.strip("/")).replace(r"\*\*", ".*").replace(r"\*", "[^/]*")
    short = component.rpartition("/")[2]
    return bool(re.fullmatch(pattern, component)) or node.strip("/") == short


def _flat(value: Any, at: str, depth: int) -> Iterator[tuple[str, str]]:
    if depth > _DEPTH:
        raise ValueError(f"`{at}` is nested too deep")
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(inner, f"{at}.{key}" if at else str(key), depth + 1)
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from _flat(inner, f"{at}[{number}]", depth + 1)
    elif value is not None and at:
        yield at, str(value)
    else:
        raise ValueError(f"`{at or _KEY}` has no value")
