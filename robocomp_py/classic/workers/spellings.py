"""The names that RoboComp's components use for ports and operations, in all generations; present names first."""

from __future__ import annotations

import keyword
from typing import Any

from ...contract.component import Port
from ...contract.interface import Operation, Pattern

_KEYWORDS = {*keyword.kwlist, "exec", "print"}

WITH_DEADLINE = ("ice_timeout", "ice_invocationTimeout")
AS_IT_IS = ("ice_oneway", "ice_twoway", "ice_context")
"""Methods of Ice's proxies that return another proxy."""


def slice_name(name: str) -> str:
    """slice2py's name for an identifier that is a Python keyword."""
    return f"_{name}" if name in _KEYWORDS else name


def handlers(port: Port, operation: Operation[Any]) -> tuple[str, ...]:
    """The handler's names for an operation: since 2018, before, and without a number of the port."""
    short = port.interface.short
    return tuple(dict.fromkeys((port.handler(operation.name), operation.name, f"{short}_{operation.name}")))


def attributes(port: Port) -> tuple[str, ...]:
    """The attributes of a proxy; that of a topic also has its name before 2018."""
    return (port.attribute, port.name) if port.verb.is_topic else (port.attribute,)


def keys(port: Port) -> tuple[str, ...]:
    """The keys of a proxy in the constructor's map."""
    short, number = port.interface.short, port.number
    suffix = "Pub" if port.verb.is_topic else "Proxy"
    return f"{short}{suffix}{number}", f"{short}{number}{suffix}", f"{short}{number}"


def calls(port: Port) -> set[str]:
    """The methods of a proxy: its operations', and those of Ice's proxies."""
    found = {*WITH_DEADLINE, *AS_IT_IS}
    for operation, pattern in port.interface.under(port.verb):
        found.add(slice_name(operation.name))
        if pattern is Pattern.QUERY:
            found |= {f"{operation.name}Async", f"begin_{operation.name}", f"end_{operation.name}"}
    return found
