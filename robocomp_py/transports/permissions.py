"""The processes of a network with keys, and what each may use of another. Values only."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..contract.interface import Verb

OPERATOR = "operator@"
"""The member of a network that tools are, if its keys were made; no process can have this name."""

LONGEST_NAME = 64
"""Octets of a common name that certificates have room for."""


@dataclass(frozen=True)
class Principal:
    """A process, as seen by checks of keys."""

    name: str
    instances: tuple[str, ...]
    host: str
    channels: tuple[str, ...] = ()
    """What the channels begin with that it provides."""

    @property
    def folder(self) -> str:
        return file_name(self.name)


@dataclass(frozen=True)
class Edge:
    """What one process may use of another one."""

    client: str
    provider: str
    instance: str
    """Of the provider."""
    channel: str
    verb: Verb
    """Of the client."""
    looked_up: str
    """The name that the client looks for: the channel, or one with `*` where any instance will do."""


@dataclass(frozen=True)
class Graph:
    """The processes of a network, and what each uses of another."""

    name: str
    principals: tuple[Principal, ...]
    edges: tuple[Edge, ...]
    routers: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """By host with a helper that has a certificate, the addresses at which it is reached."""
    inner: tuple[Edge, ...] = ()
    """What instances of one process use of each other."""

    @property
    def has_operator(self) -> bool:
        return any(each.name == OPERATOR for each in self.principals)

    def uses(self, client: str) -> tuple[Edge, ...]:
        return tuple(edge for edge in self.edges if edge.client == client)

    def used_by(self, provider: str) -> tuple[Edge, ...]:
        return tuple(edge for edge in self.edges if edge.provider == provider)


def file_name(name: str) -> str:
    """The name of a folder, or file, for a process or an instance."""
    return name if name == OPERATOR else re.sub(r"[^A-Za-z0-9_-]", ".", name)


def router_name(host: str) -> str:
    """What the helper of a host is called in certificates, and its folder of keys."""
    return f"router@{file_name(host)}"


def common_name(name: str) -> str:
    """What certificates call a process: they have room for 64 octets."""
    if len(name.encode()) <= LONGEST_NAME:
        return name
    return f"{name[:40]}-{hashlib.sha256(name.encode()).hexdigest()[:16]}"
