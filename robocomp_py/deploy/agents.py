"""The contract of agents, which start processes: one agent for each host.

An agent decides nothing: its caller (`run.py`, by `policy.py`) says what to start, stop and restart, and when. All
methods are called on the event loop, and none blocks it. A name belongs to one process at a time, until `exited`
reports its end.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from ..errors import DeploymentError
from .process import Process


class Abandoned(DeploymentError):
    """The process was told to end before it had started; it does not exist."""


@dataclass(frozen=True, slots=True)
class Life:
    """The state of a component, as its process reports it."""

    state: str
    """Of its life cycle: `compute`, `emergency`, …"""
    overruns: int
    """Periods that were skipped because `compute` took longer than one."""
    missed: int
    """Deadlines of the QoS of its topics that were missed."""
    lost: int
    """How often a publisher that it hears was lost, by the lease of the QoS."""
    version: str
    """Of robocomp_py."""


@dataclass(frozen=True, slots=True)
class Usage:
    """The resources of a process and of all that it started, as far as known."""

    pid: int
    cpu_s: float = 0.0
    """Of processor time, since it was started."""
    memory: int = 0
    """Bytes, where what several processes share counts for each of them in part (PSS), or whole (RSS)."""
    calls_per_s: float = 0.0
    """How many operations its components answer, as they say it themselves."""
    worst_ms: float = 0.0
    """How long the slowest of those took, of the last interval."""
    at: float = 0.0
    """When processor time and memory were measured, in seconds of the host's clock; 0 if never."""
    lives: Mapping[str, Life] = field(default_factory=dict)
    """The states of its components, by name; of those that report one."""


class Listener(Protocol):
    """Receives the events of processes. Its exceptions are not caught."""

    def output(self, name: str, line: str) -> None:
        """The process printed a line, given without its end; a long line comes in pieces."""

    def ready(self, name: str) -> None:
        """The process has sent READY=1, or runs if it sends no notifications. At most once for each start."""

    def status(self, name: str, text: str) -> None:
        """The process has sent STATUS=."""

    def left(self, name: str, instance: str) -> None:
        """One of several components in a process has ended well; the process goes on."""

    def contract(self, name: str, instance: str, operations: Mapping[str, str]) -> None:
        """A component in it has started with this contract: its operations, and their fingerprints."""

    def hung(self, name: str) -> None:
        """The process did not feed its watchdog. It gets SIGABRT, a little time to print its stacks, and SIGKILL;
        `exited` follows."""

    def exited(self, name: str, code: int) -> None:
        """The process and all that it started have ended. Called once, after the last line of its output.

        `code` is negative for a signal, as in subprocess.
        """

    def lost(self, host: str, why: str) -> None:
        """A host is out of reach, with its processes. No further events of these follow, not even `exited`."""

    def back(self, host: str) -> None:
        """A lost host is reachable again. Assume that none of its processes runs, and start those that should: an agent
        that kept them takes over the running ones, and reports `ready` again."""


class Agent(Protocol):
    async def open(self) -> None:
        """Get ready to start processes. Raises DeploymentError, also if this network runs there already."""

    async def start(self, process: Process) -> None:
        """Raises DeploymentError if it cannot be started, and Abandoned if it is stopped meanwhile. May be called
        again once `exited` was told.
        """

    def stop(self, name: str) -> None:
        """Ask it, and all that it started, to end (SIGTERM). Nothing happens if it does not run.

        A start in progress is abandoned, or the process ends once it runs; on another host it ends after its start.
        """

    def kill(self, name: str) -> None:
        """End it, and all that it started, now (SIGKILL); otherwise as `stop`."""

    def usage(self) -> Mapping[str, Usage]:
        """The usage of the running processes by name, as last measured; costs nothing."""

    async def close(self) -> None:
        """End all processes and remove their files; may be called twice."""
