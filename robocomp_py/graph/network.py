"""What a picture of a network shows: instances inside their systems and hosts, and the links between them.

From the machine to the process, groups stand within each other: a host, the systems that have a part of them on it, a
process that several share.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..deploy.plan import Link, Plan
    from ..deploy.process import Process


class Mark(StrEnum):
    """What a picture of a running network says about an instance or an arrow."""

    NONE = ""
    MISSING = "missing"
    """It is declared, and not there."""
    UNDECLARED = "undeclared"
    """It is there, and the network does not declare it."""


class Around(StrEnum):
    NETWORK = "network"
    HOST = "host"
    SYSTEM = "system"
    PROCESS = "process"


@dataclass(frozen=True, slots=True)
class Node:
    """An instance."""

    name: str
    """The whole one, with its systems."""
    component: str
    mark: Mark = Mark.NONE
    figures: tuple[str, ...] = ()
    """What was measured, in lines below the names."""
    is_strained: bool = False
    """Whether it should be looked at: it does not answer, for example."""

    @property
    def short(self) -> str:
        return self.name.rpartition("/")[2]


@dataclass(eq=False, slots=True)
class Group:
    kind: Around
    title: str
    inner: list[Group | Node] = field(default_factory=list)

    def nodes(self) -> Iterator[Node]:
        for each in self.inner:
            if isinstance(each, Node):
                yield each
            else:
                yield from each.nodes()


@dataclass(frozen=True, slots=True)
class Edge:
    """From a client to its server, or from a publisher to a subscriber."""

    source: str
    target: str
    """"" for a topic that has no subscriber."""
    topic: bool
    middleware: str
    """What carries it; nothing if that is not known from here."""
    interfaces: tuple[str, ...]
    mark: Mark = Mark.NONE
    figures: tuple[str, ...] = ()
    """What was measured, in lines below the interfaces."""
    is_strained: bool = False
    """Whether it loses something, fails, or is near a deadline."""


@dataclass(frozen=True, slots=True)
class Graph:
    name: str
    root: Group
    edges: tuple[Edge, ...]


@dataclass(frozen=True, slots=True)
class Place:
    """A process, and what is around it."""

    nodes: tuple[Node, ...]
    host: str = ""
    """Its title; "" if no host is drawn."""
    systems: tuple[str, ...] = ()
    process: str = ""
    """Its title; "" if it is not drawn."""


def nested(name: str, places: Iterable[Place]) -> Group:
    """Instances within processes, systems and hosts."""
    root = Group(Around.NETWORK, name)
    groups: dict[tuple[str, ...], Group] = {}

    def group(key: tuple[str, ...], kind: Around, title: str, outer: Group) -> Group:
        if key not in groups:
            groups[key] = Group(kind, title)
            outer.inner.append(groups[key])
        return groups[key]

    for place in places:
        inside = root
        key: tuple[str, ...] = (place.host,)
        if place.host:
            inside = group(key, Around.HOST, place.host, inside)
        for system in place.systems:
            key = (*key, system)
            inside = group(key, Around.SYSTEM, system, inside)
        if place.process:
            inside = group((*key, "", place.process), Around.PROCESS, place.process, inside)
        inside.inner += place.nodes
    return root


def graph_of(plan: Plan) -> Graph:
    addresses = {host.name: host.address for host in plan.hosts}
    places = (
        Place(
            tuple(_nodes(process)),
            host_title(process.host, addresses.get(process.host, "")) if plan.hosts else "",
            process.system,
            process.name.rpartition("/")[2] if process.members else "",
        )
        for process in plan.processes
    )
    return Graph(plan.name, nested(plan.name, places), tuple(_edges(plan)))


def host_title(name: str, address: str) -> str:
    """A host for people; "" is the machine that launches the network."""
    return (f"{name} ({address})" if address not in ("", name) else name) or "this machine"


def _nodes(process: Process) -> list[Node]:
    if process.members:
        return [Node(member.name, member.component) for member in process.members]
    return [Node(process.name, process.component)]


def _edges(plan: Plan) -> Iterator[Edge]:
    """One for all interfaces that two instances have in common in the same way."""
    found: dict[tuple[str, str, bool, str], list[str]] = {}
    for link in plan.links:
        ends = (link.provider, link.client) if link.verb.is_topic else (link.client, link.provider)
        for middleware in _middlewares(plan, link) or [""]:
            interfaces = found.setdefault((*ends, link.verb.is_topic, middleware), [])
            name = f"{link.named}/{link.interface}" if link.named else link.interface
            if name not in interfaces:
                interfaces.append(name)
    for key, interfaces in found.items():
        yield Edge(*key, tuple(interfaces))


def _middlewares(plan: Plan, link: Link) -> list[str]:
    return list(
        dict.fromkeys(
            way.middleware
            for way in plan.ways
            if (way.client, way.source, way.verb) == (link.client, link.source, link.verb)
            and way.interface.rpartition(".")[2] == link.interface
        )
    )
