"""What a .ddsl file says, and where."""

from __future__ import annotations

from dataclasses import dataclass

from ..cdsl.model import Setting
from ..source import Name, Source, Span


@dataclass(frozen=True, slots=True)
class Wiring:
    """`requires Laser from laser1;`: which instance a port uses."""

    verb: Name
    port: Name
    instance: Name
    span: Span


@dataclass(frozen=True, slots=True)
class Quality:
    """`qos subscribesTo LaserPub(best_effort, depth 1);`: of a port, whatever its component says. No verb: any port."""

    verb: Name | None
    port: Name
    settings: tuple[Setting, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Variable:
    """Of an instance's environment."""

    name: Name
    value: Name
    span: Span


@dataclass(frozen=True, slots=True)
class Clause:
    """That something was said, and where; what it says is in the model."""

    kind: str
    span: Span


@dataclass(frozen=True, slots=True)
class Instance:
    """One component of the deployment. `kind` is the name in its CDSL, if it is not the instance's own."""

    name: Name
    span: Span
    kind: Name | None = None
    path: Name | None = None
    ip: Name | None = None
    port: Name | None = None
    config: Name | None = None
    dependences: tuple[Name, ...] = ()
    middleware: Name | None = None
    env: tuple[Variable, ...] = ()
    args: tuple[Name, ...] = ()
    wirings: tuple[Wiring, ...] = ()
    process: Name | None = None
    """The one it shares with others that name it, if it has none of its own."""
    qos: tuple[Quality, ...] = ()
    later: tuple[Name, ...] = ()
    """Words that are spoken for, but have no effect yet."""
    clauses: tuple[Clause, ...] = ()
    """All of them, in order."""

    @property
    def component(self) -> Name:
        return self.kind or self.name

    @property
    def runs_in(self) -> Name:
        """What its process is called."""
        return self.process or self.name


@dataclass(frozen=True, slots=True)
class Deployment:
    source: Source
    imports: tuple[Name, ...]
    name: Name
    span: Span
    instances: tuple[Instance, ...]
    middleware: Name | None = None
    namespace: str = ""
    later: tuple[Name, ...] = ()
    clauses: tuple[Clause, ...] = ()
    """All but the instances, in order."""
    skipped: frozenset[str] = frozenset()
    """The words that syntax errors left out of the model."""
