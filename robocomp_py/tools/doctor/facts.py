"""What the checks look at, and what they find. Values only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from ...runtime.RoboCompIntrospection import Description, Measures
from ..network import Network


class Weight(StrEnum):
    ERROR = "error"
    """Something does not work."""
    WARN = "warn"
    """Something will not work, or does not work well."""
    NOTE = "note"
    """Something may be meant to be so."""


@dataclass(frozen=True, slots=True)
class Finding:
    weight: Weight
    text: str
    """What is wrong, and where; without control characters."""
    advice: str
    """What to do."""
    host: str = ""
    """The host that is meant; "" for this one, or if the text names it."""


@dataclass(frozen=True, slots=True)
class Process:
    """A process of this host that takes part in a network."""

    pid: int
    open_files: int
    most_files: int
    """The limit of open files; 0 if it is unknown."""
    state: str = ""
    """The letter of Linux for its state; "" if that is unknown."""


@dataclass(frozen=True, slots=True)
class Used:
    """A limit of the system for this user, and what of it is in use."""

    used: int
    most: int
    """0 if it is unknown."""


@dataclass(frozen=True, slots=True)
class Space:
    """A file system."""

    path: str
    purpose: str
    """What is kept there."""
    size: int
    """In octets."""
    free: int
    files: int
    """How many files there can be; 0 if there is no limit."""
    free_files: int


@dataclass(frozen=True, slots=True)
class Machine:
    processes: tuple[Process, ...] = ()
    inotify_instances: Used = Used(0, 0)
    inotify_watches: Used = Used(0, 0)
    memory: Space | None = None
    """Shared memory; None if no middleware uses it here."""
    missing_memory: str = ""
    """Where shared memory is missing."""
    disks: tuple[Space, ...] = ()


@dataclass(frozen=True, slots=True)
class Left:
    """What killed processes of one middleware have left."""

    middleware: str
    living: int
    """Processes of this host that use it now."""
    dead: int
    """Entries in the directory, sockets and claims of processes that have ended."""
    memory: int = 0
    """Files in shared memory that belong to nothing alive."""


@dataclass(frozen=True, slots=True)
class Asked:
    """A component, and what it answered."""

    name: str
    """Its whole name, as `robot1/world`."""
    pid: int = 0
    state: str = ""
    """The letter of Linux for the state of its process; "" if that is unknown."""
    description: Description | None = None
    measures: Measures | None = None
    offset: float | None = None
    """Seconds by which its clock is ahead of ours; None if that was not measured."""
    inaccuracy: float = 0.0
    """Seconds by which `offset` may be wrong."""
    host: str = ""
    """The name of its host in its network; "" for this one, or if that is not known."""


@dataclass(frozen=True, slots=True)
class Place:
    """Another host of a network."""

    host: str
    machine: Machine
    left: tuple[Left, ...]
    offset: float
    """As that of `Asked`."""
    inaccuracy: float


@dataclass(frozen=True, slots=True)
class Launched:
    """A process of a network, as its launcher knows it."""

    network: str
    name: str
    state: str
    """`ready`, `failed`, …"""
    how: str = ""
    """The reason for its state, if there is one."""
    restarts: int = 0
    is_wrong: bool = False
    """Whether it should be in another state."""


@dataclass(frozen=True, slots=True)
class Complaints:
    """The errors that one component has logged since its start."""

    network: str
    name: str
    """Of its process."""
    instance: str
    count: int
    newest: str
    """The text of the newest."""


@dataclass(frozen=True)
class Facts:
    host: str
    """The name that this host, and components on it, give it."""
    machine: Machine = Machine()
    network: Network = field(default_factory=lambda: Network(()))
    components: tuple[Asked, ...] = ()
    left: tuple[Left, ...] = ()
    killed_networks: tuple[str, ...] = ()
    """Networks whose launcher was killed."""
    plans: tuple[Mapping[str, Any], ...] = ()
    """Of networks that run, or are meant to: `Plan.to_json`."""
    launched: tuple[Launched, ...] = ()
    complaints: tuple[Complaints, ...] = ()
    tellers: Mapping[str, frozenset[str]] | None = None
    """The middlewares that could tell what uses them, by host; None: all of this host."""
    places: tuple[Place, ...] = ()
    """Other hosts."""
    place: str = ""
    """The host of `machine` and `left`: "", this one, except in what `on` returns."""

    def on(self, place: Place) -> Facts:
        """The same with the machine of another host."""
        return replace(self, place=place.host, machine=place.machine, left=place.left, killed_networks=())

    def log_of(self, name: str) -> str:
        """The command that shows the log of an instance, by its whole name."""
        for plan in self.plans:
            ours = plan.get("ours")
            for declared, each in ours.items() if isinstance(ours, Mapping) else ():
                if isinstance(each, Mapping) and each.get("channels") == name:
                    return f"rcdeploy logs {plan.get('name')} {declared} --level warning"
        return f"where {name} was started, or by rcdeploy logs"


def size(octets: float) -> str:
    """An amount of memory, for people."""
    units = ["B", "kB", "MB", "GB", "TB"]
    while octets >= 1000 and len(units) > 1:
        octets /= 1000
        units.pop(0)
    return f"{octets:.3g} {units[0]}"
