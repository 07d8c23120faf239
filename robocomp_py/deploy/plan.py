"""What a deployment comes to: the processes of a network, where each runs, and what carries its messages.

Values only; `planner.py` makes them out of a DDSL file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

from ..contract.interface import Verb
from .auto import Way
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
    """"" for whom SSH's own configuration names."""
    port: int = 0
    """Of its SSH server; 0 for what SSH's own configuration says."""
    workdir: str = ""
    """Where processes run; "" for a folder of its own below the user's home."""
    python: str = "python3"
    keep: bool = False
    """Whether processes there go on when whoever launched them is gone."""


class Security(StrEnum):
    """Who may take part in a network."""

    LOCAL = "local"
    """Who is this user on this machine: loopback, sockets and shared memory of one folder."""
    LAN = "lan"
    """Who has a key that `rcdeploy keys` made; everything is encrypted."""
    OPEN = "open"
    """Everybody who reaches it."""


@dataclass(frozen=True)
class Plan:
    """A network, checked. `processes` are in an order in which they can be started."""

    name: str
    middleware: str
    processes: tuple[Process, ...]
    links: tuple[Link, ...]
    transports: tuple[OpenedTransport, ...] = ()
    """What carries its messages, as its components will open it."""
    ways: tuple[Way, ...] = ()
    """What carries each operation between each two instances that we know."""
    notes: tuple[str, ...] = ()
    """Why something is not carried by what would be fastest."""
    hosts: tuple[Host, ...] = ()
    """Those besides the one that launches it."""
    escalations: Mapping[tuple[str, ...], Escalation] = field(default_factory=dict)
    """By system; that of the whole network by the empty one."""
    security: Security = Security.LOCAL
    routers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """By host that needs one, the settings of its Zenoh router; "" is the one that launches the network."""
    storms: tuple[str, ...] = ()
    """The TopicManagers of IceStorm whose topics it uses, as proxies."""

    @property
    def carriers(self) -> tuple[str, ...]:
        """The middlewares of its links; without links, those of its components."""
        return tuple(dict.fromkeys(way.middleware for way in self.ways)) or tuple(
            dict.fromkeys(each.middleware for each in self.transports)
        )

    def to_json(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "middleware": self.middleware,
            "security": str(self.security),
            "hosts": [asdict(each) for each in self.hosts],
            "escalations": {"/".join(path): str(each) for path, each in self.escalations.items()},
            "processes": [_process_to_json(each) for each in self.processes],
            "links": [
                {"interface": each.interface, "provider": each.provider, "client": each.client, "verb": str(each.verb)}
                for each in self.links
            ],
            "transports": [asdict(each) for each in self.transports],
            "ways": [asdict(each) for each in self.ways],
            "routers": {host: dict(settings) for host, settings in self.routers.items()},
            "storms": list(self.storms),
            "notes": list(self.notes),
        }


def _process_to_json(process: Process) -> dict[str, Any]:
    return {
        "name": process.name,
        "component": process.component,
        "instances": list(process.instances),
        "command": list(process.command),
        "cwd": str(process.cwd),
        "env": dict(process.env),
        "after": list(process.after),
        "notifies": process.notifies,
        "is_program": process.is_program,
        "host": process.host,
        "restart": {**asdict(process.restart), "when": str(process.restart.when)},
        "grace": process.grace,
        "system": list(process.system),
        "files": [str(path) for path in process.files],
    }


@dataclass(frozen=True)
class Overrides:
    """What the command line says about a network: `--middleware`, and `--set INSTANCE.KEY=VALUE`."""

    middleware: str | None = None
    settings: tuple[tuple[str, str], ...] = ()

    def of(self, instance: str) -> list[str]:
        """The assignments for one instance; `*` is for all."""
        return [assignment for name, assignment in self.settings if name in (instance, "*")]
