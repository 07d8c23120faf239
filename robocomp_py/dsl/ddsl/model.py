"""What a .ddsl file says, and where."""

from __future__ import annotations

from dataclasses import dataclass

from ..cdsl.model import Amount, Setting
from ..source import Name, Source, Span


@dataclass(frozen=True, slots=True)
class Wiring:
    """`requires Laser from laser1 middleware dds;`: the instance that a port uses, and the middleware between them."""

    verb: Name
    port: Name
    instance: Name
    """The whole name of an instance, or of a named instance that another one offers."""
    span: Span
    middleware: Name | None = None


@dataclass(frozen=True, slots=True)
class Quality:
    """`qos subscribesTo LaserPub(best_effort, depth 1);`: overrides the QoS of a port. Without a verb: any port."""

    verb: Name | None
    port: Name
    settings: tuple[Setting, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Offer:
    """`offers front : Laser, LaserPub port 10003;`: a named instance, and the interfaces that it provides."""

    name: Name
    """The full name, as that of an instance beside the one that offers it: `left/front`."""
    interfaces: tuple[Name, ...]
    span: Span
    port: Name | None = None

    @property
    def local(self) -> str:
        """Its name in its system."""
        return self.name.text.rpartition("/")[2]


@dataclass(frozen=True, slots=True)
class Variable:
    """Of an instance's environment."""

    name: Name
    value: Name
    span: Span


@dataclass(frozen=True, slots=True)
class Clause:
    """The kind and the place of a clause; its content is in the model."""

    kind: str
    span: Span


@dataclass(frozen=True, slots=True)
class Host:
    """`host onboard { address "192.168.1.10"; user "robot"; };`: a machine that is reached over SSH."""

    name: Name
    span: Span
    address: Name | None = None
    user: Name | None = None
    port: Name | None = None
    """Of its SSH server."""
    workdir: Name | None = None
    python: Name | None = None
    lost: Name | None = None
    """Whether its processes `stop` or are kept (`keep`) when their launcher is gone."""
    clauses: tuple[Clause, ...] = ()


@dataclass(frozen=True, slots=True)
class Restart:
    """`restart on_failure(intensity 5, period 60);`: whether an instance is restarted when it has ended."""

    policy: Name
    settings: tuple[Setting, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Clock:
    """`clock world(speed 10);`: the instance whose clock all others follow."""

    leader: Name
    """Its whole name."""
    settings: tuple[Setting, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class System:
    """`System left { … };`: instances under a prefix, with clauses for all of them."""

    name: Name
    """The full name, which begins with the systems around it: `left/wrist`."""
    span: Span
    host: Name | None = None
    restart: Restart | None = None
    escalation: Name | None = None
    clauses: tuple[Clause, ...] = ()


@dataclass(frozen=True, slots=True)
class Instance:
    """One component of the deployment. `kind` is the name in its CDSL, if it is not the instance's own."""

    name: Name
    """The full name, which begins with the systems around it: `left/arm`. Its place is that of the last part."""
    span: Span
    kind: Name | None = None
    path: Name | None = None
    ip: Name | None = None
    port: Name | None = None
    config: Name | None = None
    dependences: tuple[Name, ...] = ()
    """Whole names."""
    middleware: Name | None = None
    env: tuple[Variable, ...] = ()
    args: tuple[Name, ...] = ()
    wirings: tuple[Wiring, ...] = ()
    offers: tuple[Offer, ...] = ()
    process: Name | None = None
    """The process that it shares with other instances of its system; None if it has its own."""
    qos: tuple[Quality, ...] = ()
    allow: tuple[Name, ...] = ()
    """Its interfaces and operations that an agent may call, as they are written: `GotoPoint/go`."""
    host: Name | None = None
    restart: Restart | None = None
    grace: Amount | None = None
    """The time that it may take to stop."""
    existing: Name | None = None
    """The command line of a program that is not a generated component."""
    notifies: Clause | None = None
    """Set if the program reports that it is ready."""
    clauses: tuple[Clause, ...] = ()
    """All of them, in order."""

    @property
    def component(self) -> Name:
        return self.kind or Name(self.local, self.name.span)

    @property
    def system(self) -> tuple[str, ...]:
        """The systems around it, the outermost first."""
        return tuple(self.name.text.split("/")[:-1])

    @property
    def local(self) -> str:
        """Its name in its system."""
        return self.name.text.rpartition("/")[2]

    @property
    def program(self) -> Name | None:
        """The clause that makes it a program instead of a generated component, if there is one."""
        return self.path or self.existing

    @property
    def runs_in(self) -> Name:
        """The name of its process."""
        return self.process or self.name


@dataclass(frozen=True, slots=True)
class Deployment:
    source: Source
    imports: tuple[Name, ...]
    name: Name
    span: Span
    instances: tuple[Instance, ...]
    """In the order of the file, including those in systems."""
    middleware: Name | None = None
    namespace: str = ""
    hosts: tuple[Host, ...] = ()
    systems: tuple[System, ...] = ()
    """Including nested systems, each after the one that contains it."""
    restart: Restart | None = None
    """The default for instances without a `restart` of their own."""
    escalation: Name | None = None
    security: Name | None = None
    clock: Clock | None = None
    allow: tuple[Name, ...] = ()
    """What an agent may call, as it is written: `wander/GotoPoint/go`."""
    clauses: tuple[Clause, ...] = ()
    """All but hosts, systems and instances, in order."""
    skipped: frozenset[str] = frozenset()
    """The words that syntax errors left out of the model."""
