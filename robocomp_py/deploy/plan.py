"""The plan of a network: its processes, their hosts, and the middlewares of its messages.

Values only; `planner.py` makes them out of a DDSL file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from ..contract.interface import Pattern, Verb
from ..contract.told import Supplement
from ..transports.network import Helper, Way
from .asjson import to_json
from .policy import Escalation
from .process import Member as Member
from .process import Process as Process


@dataclass(frozen=True)
class Link:
    """An interface that one instance offers and another one uses."""

    interface: str
    provider: str
    client: str
    verb: Verb
    named: str = ""
    """The named instance of the provider, in its system; "" if the provider offers it by its own name."""

    @property
    def source(self) -> str:
        """What is used, for people: `world`, or `world/front` for a named instance."""
        return f"{self.provider}/{self.named}" if self.named else self.provider


@dataclass(frozen=True)
class OpenedTransport:
    """A middleware with its options; components with the same ones meet."""

    middleware: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Host:
    """A machine that is reached over SSH."""

    name: str
    address: str
    user: str = ""
    """The user to log in as; "" for the one in SSH's own configuration."""
    port: int = 0
    """The port of its SSH server; 0 for the one in SSH's own configuration."""
    workdir: str = ""
    """Where processes run; "" for a folder of its own below the user's home."""
    python: str = "python3"
    keep: bool = False
    """Whether processes there keep running when their controller is lost."""


@dataclass(frozen=True)
class Ours:
    """An instance of a component that rcgen generated."""

    folder: Path
    operations: Mapping[str, str]
    """The operations of its interfaces, with their fingerprints."""
    channels: str
    """The prefix of its channels."""
    over: tuple[str, ...]
    """The middlewares that it opens, each with its domain if one is set."""
    topics: tuple[str, ...] = ()
    """The channels that it publishes."""


@dataclass(frozen=True)
class Served:
    """A channel of a foreign program, which announces nothing: its description for tools."""

    instance: str
    owner: str
    """What it would announce: the prefix of its channels."""
    channel: str
    pattern: Pattern
    fingerprint: int
    text: str
    """Its contract."""
    supplement: Supplement
    """What the text does not contain."""


@dataclass(frozen=True)
class Programs:
    """What foreign programs serve over one middleware."""

    middleware: str
    options: Mapping[str, Any]
    """With which a tool reaches them."""
    serve: tuple[Served, ...]


@dataclass(frozen=True)
class Allowed:
    """An operation that an agent may use."""

    instance: str
    named: str
    """The named instance, in its system; "" if the instance itself serves it."""
    interface: str
    """As the names of its channels have it: `Laser`, `Laser1`."""
    operation: str
    kind: str
    """`call` of a query or command, `goal` of an action, `publication` to a topic that the instance subscribes to."""


class Security(StrEnum):
    """Which processes may take part in a network."""

    LOCAL = "local"
    """Processes of this user on this machine: loopback, sockets and shared memory of one folder."""
    LAN = "lan"
    """Processes with a key made by `rcdeploy keys`; all traffic is encrypted."""
    OPEN = "open"
    """Every process that reaches it."""


@dataclass(frozen=True)
class Plan:
    """A network, checked. `processes` are in an order in which they can be started."""

    name: str
    middleware: str
    processes: tuple[Process, ...]
    links: tuple[Link, ...]
    transports: tuple[OpenedTransport, ...] = ()
    """Its middlewares, as its components will open them."""
    ways: tuple[Way, ...] = ()
    """The middleware of each operation between two known instances."""
    notes: tuple[str, ...] = ()
    """Why a link does not use the fastest middleware."""
    hosts: tuple[Host, ...] = ()
    """Those besides the one that launches it."""
    escalations: Mapping[tuple[str, ...], Escalation] = field(default_factory=dict)
    """By system; "" is the whole network."""
    security: Security = Security.LOCAL
    helpers: tuple[Helper, ...] = ()
    """The helpers that its transports need on its hosts."""
    ours: Mapping[str, Ours] = field(default_factory=dict)
    """Of all instances except foreign programs, by name."""
    clock: str = ""
    """The instance whose clock all others follow; "" if each has its own."""
    allow: tuple[Allowed, ...] = ()
    """What an agent may call through `rc mcp`."""
    programs: tuple[Programs, ...] = ()
    """The foreign programs whose places are known."""

    @property
    def carriers(self) -> tuple[str, ...]:
        """The middlewares of its links; without links, those of its components."""
        return tuple(dict.fromkeys(way.middleware for way in self.ways)) or tuple(
            dict.fromkeys(each.middleware for each in self.transports)
        )

    def to_json(self) -> dict[str, Any]:
        processes = [to_json(each) | {"instances": list(each.instances)} for each in self.processes]
        whole: dict[str, Any] = to_json(self)
        return whole | {"processes": processes}


@dataclass(frozen=True)
class Overrides:
    """The settings of a network on the command line: `--middleware`, `--clock`, `--set` and `--diary`."""

    middleware: str | None = None
    settings: tuple[tuple[str, str], ...] = ()
    clock: str | None = None
    """The instance that leads the clock; "" for none, None for what the network says."""
    speed: float | None = None
    """Of the clock; 0 for as fast as possible."""
    diaries: tuple[tuple[str, str], ...] = ()
    """As `settings`: what makes instances write a diary, as `--diary INSTANCE` asks for."""

    def of(self, instance: str) -> list[str]:
        """The assignments for one instance; `*` is for all."""
        found = [assignment for name, assignment in self.settings if name in (instance, "*")]
        return found + [assignment for name, assignment in self.diaries if name == instance]

    def option(self, instance: str, assignment: str) -> str:
        """The option that asked for an assignment, as it was given."""
        if (instance, assignment) in self.diaries:
            return f"--diary {instance}"
        subject = instance if (instance, assignment) in self.settings else "*"
        return f"--set {subject}.{assignment}"
