"""The present state of a running network, for `rcdeploy status` and the table on a terminal.

The runner (`run.py`) implements `Network`. What is in a snapshot is text and numbers: `dataclasses.asdict`
of it can be written as JSON as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from .agents import Life, Usage
from .events import EndRequested, RestartRequested, StopRequested
from .policy import State

if TYPE_CHECKING:
    from .scouting import Scout


@dataclass(frozen=True, slots=True)
class ProcessStatus:
    """One process of the plan, whether it runs or not."""

    name: str
    component: str
    instances: tuple[str, ...]
    """Its instances; often one of the same name."""
    ended: tuple[str, ...]
    """Its instances that have ended while others go on."""
    host: str
    """"" for the machine of the one that launched the network."""
    state: State
    how: str
    """The reason for its state, if any: how it ended, or that its host is out of reach."""
    pid: int | None
    """None if it does not run, or if it is unknown."""
    in_state: float
    """Seconds since the state changed."""
    uptime: float | None
    """Seconds since it was started; None if it does not run."""
    next_start: float | None
    """Seconds until it is started again, if it is going to be."""
    starts: int
    """How often it has been started."""
    restarts: int
    """How often it has been started again, for any reason."""
    cpu: float | None
    """Cores that it has used since the last measurement, for example 0.25; None if unknown."""
    memory: int | None
    """Bytes."""
    calls: float | None
    """Calls that it answered, per second; None if it does not report them."""
    worst: float | None
    """Seconds that the slowest of them took."""
    status: str
    """Its last status text."""
    lives: Mapping[str, Life] = field(default_factory=dict)
    """The state of each instance that reports one, and what it missed."""
    contracts: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """By instance, the operations of its interfaces with the fingerprints that it has started with."""


@dataclass(frozen=True, slots=True)
class HostStatus:
    name: str
    address: str
    reachable: bool
    why: str
    """Why it is not reachable."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    network: str
    up: bool
    """Whether everything has been ready."""
    stopping: bool
    why: str
    """Why it stops."""
    uptime: float
    """Seconds since it was launched."""
    hosts: tuple[HostStatus, ...]
    """Those besides the one that launched it."""
    processes: tuple[ProcessStatus, ...]
    """In the order in which they start."""


class Network(Protocol):
    """A network that runs. To be used on its event loop only."""

    def snapshot(self) -> Snapshot: ...

    def ask(self, event: RestartRequested | EndRequested | StopRequested) -> None:
        """Request an action; it is carried out soon.

        Raises DeploymentError, with a sentence for the user, if a name is unknown or if it is too late.
        A restart is done when the processes are ready and their `starts` are more than they were.
        """

    def scout(self, host: str) -> Scout:
        """Start a scout on a host. Raises HostUnreachable, and DeploymentError if there is no such host."""


class Meter:
    """The present processor usage of each process, from its total."""

    def __init__(self) -> None:
        self._read: dict[str, Usage] = {}
        self._cores: dict[str, float] = {}

    def read(self, usage: Mapping[str, Usage]) -> None:
        """Agents measure less often than they are asked."""
        for name, used in usage.items():
            before = self._read.get(name)
            if before is None or before.pid != used.pid:
                self._cores.pop(name, None)
            elif used.at > before.at > 0:
                self._cores[name] = max(0.0, used.cpu_s - before.cpu_s) / (used.at - before.at)
            self._read[name] = used

    def cores(self, name: str, pid: int) -> float | None:
        """None if it has not been measured twice since its start."""
        before = self._read.get(name)
        return self._cores.get(name) if before and before.pid == pid else None
