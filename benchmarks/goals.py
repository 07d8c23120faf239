"""What is aimed at, and what was found: one table of both, for the first page.

A measurement makes findings, each for one goal. The guard compares their ratios with earlier ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .tables import Table


@dataclass(frozen=True)
class Goal:
    what: str
    demand: str


GOALS = {
    "small": Goal("query, 64 B and 1 KB, ours ÷ raw library", "≤ 1.15 ×, or raw + 12 µs"),
    "large": Goal("query, 1 MB and 6 MB, ours ÷ raw library", "≤ 1.10 ×"),
    "inproc": Goal("query within one process", "≤ 10 µs"),
    "latency": Goal("publish → handler, latency, ours ÷ raw", "≤ 1.15 ×"),
    "rate": Goal("publish → handler, messages per second, raw ÷ ours", "≤ 1.15 ×"),
    "loan": Goal("shm, a loaned and filled message → handler, 6 MB ÷ 64 B", "≤ 2 ×"),
    "xcdr1": Goal("XCDR1, times as quick as the cyclonedds package", "≥ 100, 5, 20, 3 ×"),
    "messagepack": Goal("MessagePack, times as quick as plain `msgpack`", "≥ 1 ×; arrays ≥ 50 ×"),
    "peers": Goal("query on one host, other frameworks ÷ ours, p50", "> 1 × at every size"),
    "idle": Goal("CPU of an idle component", "≤ 0.3 % of a core"),
    "busy": Goal("CPU of a publisher and a subscriber, 1 KB at 100 Hz, both together", "≤ 6 % of a core"),
    "memory": Goal("memory of a component with one interface", "≤ 60 MB"),
    "start": Goal("start of a component, to `ready`", "≤ 0.3 s; dds ≤ 0.5 s"),
}
"""In the order of the table."""


@dataclass(frozen=True)
class Finding:
    """For one goal, of one `subject`; `case` tells several of a subject apart.

    `ratio` is what the guard compares, if anything: the greater, the worse.
    """

    goal: str
    subject: str
    case: str
    shown: str
    met: bool
    ratio: float | None = None

    @property
    def name(self) -> str:
        """What this is called among the others."""
        return " · ".join(filter(None, (self.goal, self.subject, self.case)))


def failed(goal: str, subject: str, case: str = "") -> Finding:
    """There is no figure: what was to be measured did not work."""
    return Finding(goal, subject, case, "failed", met=False)


def table(findings: Sequence[Finding]) -> Table:
    cells = []
    for name, goal in GOALS.items():
        found = [each for each in findings if each.goal == name]
        missed = _by_subject([(each.subject, each.case) for each in found if not each.met], ", ")
        verdict = "not measured" if not found else f"missed: {missed}" if missed else "met"
        cells.append(
            (goal.what, goal.demand, verdict, _by_subject([(each.subject, each.shown) for each in found], " · "))
        )
    return Table("summary", "what was aimed at", ("what", "goal", "", "found"), cells, labels=4)


def _by_subject(pairs: Iterable[tuple[str, str]], separator: str) -> str:
    subjects: dict[str, list[str]] = {}
    for subject, said in pairs:
        subjects.setdefault(subject, []).append(said)
    return "; ".join(f"{subject} {separator.join(said)}".strip() for subject, said in subjects.items())
