"""One process of a network, with all that an agent needs to start it, also on a host where networks are not read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from .policy import Restart


@dataclass(frozen=True)
class Member:
    """An instance in a process that has a name of its own."""

    name: str
    component: str


@dataclass(frozen=True)
class Process:
    """One process to run."""

    name: str
    component: str
    """The name of its component, or of several if it has several members."""
    command: tuple[str, ...]
    cwd: Path
    env: Mapping[str, str] = field(default_factory=dict)
    after: tuple[str, ...] = ()
    """Those that must be ready before it is started."""
    notifies: bool = True
    """Whether it reports that it is ready; otherwise it counts as ready once it runs."""
    is_program: bool = False
    """Whether it is a foreign program rather than generated components."""
    members: tuple[Member, ...] = ()
    """Its instances, in the order in which they start; empty if it has just the one of its name."""
    host: str = ""
    """Which of the plan's hosts it runs on; "" for the one that launches the network."""
    restart: Restart = field(default_factory=Restart)
    grace: float | None = None
    """Seconds it has to end by itself, if the network sets them."""
    ready_after: tuple[str, ...] = ()
    """Its providers that are to be ready first, unless they are gone for good."""
    stops_before: tuple[str, ...] = ()
    """Its providers that go on until it has stopped."""
    system: tuple[str, ...] = ()
    """The systems around it, the outermost first."""
    files: tuple[Path, ...] = ()
    """The arguments of its command that are local files: folders of components, configurations, a program."""

    @property
    def instances(self) -> tuple[str, ...]:
        """Which instances of the network run in it."""
        return tuple(member.name for member in self.members) or (self.name,)

    def whole(self, local: str) -> str:
        """The network's name for an instance that reports this name: it does not know the systems around it."""
        return "/".join((*self.system, local))
