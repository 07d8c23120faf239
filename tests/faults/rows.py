"""The rows of the matrix, and what one run of a row is: see `calls`, `topics`, `frames`, `memory`, `surroundings`,
`network`, `routers`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from .checker import Allowed, Violation, check
from .history import Event
from .laboratory import Laboratory

HERE = ("zeromq", "shm", "zenoh", "dds")
"""Middlewares that reach other processes of this host."""

WAITING = 5.0
"""Seconds for which a machine may keep a process waiting where no times are judged."""


@dataclass(frozen=True)
class Run:
    """One row over one transport. `full` has all the rounds that the row names; otherwise a few of them are enough."""

    transport: str
    seed: int
    full: bool
    tell: Callable[[str], None]
    frames: int = 0
    """How many malformed ones, if that is said."""

    def laboratory(self) -> Laboratory:
        return Laboratory(self.transport)

    def check(self, history: Iterable[Event], late: float = 0.1) -> list[Violation]:
        """All violations; `late` as `Allowed` has it, and more where no times are judged."""
        return check(history, Allowed(late=late if self.full else late + WAITING))

    def rounds(self, all_of_them: int, few: int) -> int:
        return all_of_them if self.full else few


@dataclass(frozen=True)
class Figure:
    """What was measured; `limit` is what it may be at most."""

    name: str
    value: float
    unit: str = ""
    limit: float | None = None
    timed: bool = False
    """Whether it says how fast this machine is, too: then it is judged by `make faults` alone."""

    @property
    def kept(self) -> bool:
        return self.limit is None or self.value <= self.limit

    @property
    def found(self) -> str:
        """Its value and its limit."""
        within = "" if self.limit is None else f" (≤ {self.limit:.3g})"
        return f"{_rounded(self.value)}{' ' + self.unit if self.unit else ''}{within}"

    def __str__(self) -> str:
        return f"{self.name} {self.found}"


@dataclass
class Result:
    figures: list[Figure] = field(default_factory=list)
    violations: list[Violation] = field(default_factory=list)

    def misses(self, timed: bool) -> list[str]:
        """What did not hold; without `timed`, only what has nothing to do with speed."""
        figures = [str(figure) for figure in self.figures if not figure.kept and (timed or not figure.timed)]
        return [*figures, *map(str, self.violations)]


@dataclass(frozen=True)
class Row:
    name: str
    fault: str
    must: str
    transports: Sequence[str]
    seconds: float
    """What it takes over one transport, about: all of it."""
    run: Callable[[Run], Result]
    reduced: bool = True
    """Whether a few rounds of it are part of `make faults-ci`."""
    root: bool = False
    """Whether it takes root, and programs that .ci/run installs."""
    frames: int = 0
    """How many damaged frames are sent, where another number may be asked for."""

    def lasts(self, frames: int) -> float:
        """Seconds over one transport, with so many frames; 0 for as many as usual."""
        return self.seconds * (frames / self.frames if frames and self.frames else 1.0)


def _rounded(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 or value == int(value) else f"{value:.3g}"
