"""Who starts processes, one for each host: what is asked of it, and what it tells.

An agent does and decides nothing: when what is started, stopped and started again is for who asks it (`run.py`,
by `policy.py`). Everything here is called on the event loop, and nothing blocks it. One instance of a process runs
at a time under a name; until `exited` was told of it, the name is taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from ..errors import DeploymentError
from .process import Process


class Abandoned(DeploymentError):
    """A process was to end before its start had come to anything; there is none."""


@dataclass(frozen=True, slots=True)
class Life:
    """How a component is, as its process tells it."""

    state: str
    """Of its life cycle: `compute`, `emergency`, …"""
    overruns: int
    """Periods that it left out, since what it did took longer than one."""
    missed: int
    """Deadlines of the QoS of its topics that were missed."""
    lost: int
    """How often a publisher that it hears was lost, by the lease of the QoS."""
    version: str
    """Of robocomp_py."""


@dataclass(frozen=True, slots=True)
class Usage:
    """What a process uses, with all that it started, as far as that is known."""

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
    """When processor time and memory were looked at, in seconds of its host's clock; 0 if they were not yet."""
    lives: Mapping[str, Life] = field(default_factory=dict)
    """How its components are, by their names; of those that tell."""


class Listener(Protocol):
    """Who is told what becomes of the processes. What it raises is not caught."""

    def output(self, name: str, line: str) -> None:
        """A line of what it printed, without its end; a long one in pieces."""

    def ready(self, name: str) -> None:
        """It said so (READY=1); or it runs, if it is none that says so. At most once a start."""

    def status(self, name: str, text: str) -> None:
        """What it says it does (STATUS=)."""

    def left(self, name: str, instance: str) -> None:
        """One of several components in a process has ended well; the process goes on."""

    def contract(self, name: str, instance: str, operations: Mapping[str, str]) -> None:
        """A component in it has started with this contract: its operations, and their fingerprints."""

    def hung(self, name: str) -> None:
        """It did not feed its watchdog. It has been sent SIGABRT, has a little time to say where it was, and is killed
        then: `exited` follows."""

    def exited(self, name: str, code: int) -> None:
        """It has ended, with all that it started; told once, after the last line of its output.

        `code` is negative for a signal, as in subprocess.
        """

    def lost(self, host: str, why: str) -> None:
        """A host is out of reach, and so are its processes: nothing more is told of them, `exited` neither."""

    def back(self, host: str) -> None:
        """A host that was lost is within reach again. None of its processes is to be taken as running: start what
        should run; an agent that kept them takes over what runs there, and tells `ready` of it once more."""


class Agent(Protocol):
    async def open(self) -> None:
        """Get ready to start processes. Raises DeploymentError, also if this network runs there already."""

    async def start(self, process: Process) -> None:
        """Raises DeploymentError if it cannot be started, and Abandoned if it is stopped meanwhile. May be called
        again once `exited` was told.
        """

    def stop(self, name: str) -> None:
        """Ask it, and all that it started, to end (SIGTERM). Nothing happens if it does not run.

        One that is just being started is not, or ends as soon as it is there; another host hears of it after the start.
        """

    def kill(self, name: str) -> None:
        """End it, and all that it started, now (SIGKILL); else as `stop`."""

    def usage(self) -> Mapping[str, Usage]:
        """Of those that run, by name; as of a moment ago, and at no cost."""

    async def close(self) -> None:
        """Afterwards none of its processes is left, and no file of theirs; may be called twice."""
