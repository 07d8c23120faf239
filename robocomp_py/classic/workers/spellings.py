"""What a component of RoboComp's calls what its .cdsl names, in one generation or another; as today first."""

from __future__ import annotations

import keyword
from typing import Any

from ...contract.component import Port
from ...contract.interface import Operation, Pattern

_KEYWORDS = {*keyword.kwlist, "exec", "print"}

WITH_DEADLINE = ("ice_timeout", "ice_invocationTimeout")
AS_IT_IS = ("ice_oneway", "ice_twoway", "ice_context")
"""What Ice's proxies have that gives another proxy."""


def slice_name(name: str) -> str:
    """How slice2py spells a name that means something in Python."""
    return f"_{name}" if name in _KEYWORDS else name


def handlers(port: Port, operation: Operation[Any]) -> tuple[str, ...]:
    """Its method for an operation: as since 2018, as before, as if there were one such port."""
    short = port.interface.short
    return tuple(dict.fromkeys((port.handler(operation.name), operation.name, f"{short}_{operation.name}")))


def attributes(port: Port) -> tuple[str, ...]:
    """Where a proxy is: as always; that of a topic also as before 2018."""
    return (port.attribute, port.name) if port.verb.is_topic else (port.attribute,)


def keys(port: Port) -> tuple[str, ...]:
    """A proxy in the map that the constructor is given."""
    short, number = port.interface.short, port.number
    suffix = "Pub" if port.verb.is_topic else "Proxy"
    return f"{short}{suffix}{number}", f"{short}{number}{suffix}", f"{short}{number}"


def calls(port: Port) -> set[str]:
    """What its proxy has: what an operation is called by, and what Ice's proxies have."""
    found = {*WITH_DEADLINE, *AS_IT_IS}
    for operation, pattern in port.interface.under(port.verb):
        found.add(slice_name(operation.name))
        if pattern is Pattern.QUERY:
            found |= {f"{operation.name}Async", f"begin_{operation.name}", f"end_{operation.name}"}
    return found
