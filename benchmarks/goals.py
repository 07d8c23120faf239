"""Goals and findings, in one table for the first page.

A measurement returns findings, each for one goal. The guard compares their ratios with earlier ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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
    "counters": Goal("counters of operations, query of 64 B", "inproc ≤ +0.2 µs; others ≤ 1.02 ×"),
    "latency": Goal("publish → handler, latency, ours ÷ raw", "≤ 1.15 ×"),
    "rate": Goal("publish → handler, messages per second, raw ÷ ours", "≤ 1.15 ×"),
    "loan": Goal("shm, a loaned and filled message → handler, 6 MB ÷ 64 B", "≤ 2 ×"),
    "records": Goal("query, 100,000 points as records ÷ as many bytes", "≤ 1.5 ×"),
    "xcdr1": Goal("XCDR1, times as quick as the cyclonedds package", "≥ 100, 5, 20, 3 ×"),
    "messagepack": Goal("MessagePack, times as quick as plain `msgpack`", "≥ 1 ×; arrays ≥ 50 ×"),
    "peers": Goal("query on one host, other frameworks ÷ ours, p50", "> 1 × at every size"),
    "idle": Goal("CPU of an idle component", "≤ 0.3 % of a core"),
    "busy": Goal("CPU of a publisher and a subscriber, 1 KB at 100 Hz, both together", "≤ 6 % of a core"),
    "memory": Goal("memory of a component with one interface", "≤ 60 MB"),
    "shared": Goal("shm, memory for messages of several sizes", "≤ 1.5 × in use + 4 MB; 4 MB afterwards"),
    "record": Goal("`rc record`, 180 MB/s + 1 kHz: lost; processor; memory", "none; ≤ 60 % of a core; ≤ 356 MB"),
    "virtual": Goal("example network in virtual time, real time ÷ its time", "≥ 36 ×"),
    "lockstep": Goal("lock-step with four followers, one instant", "shm ≤ 0.2 ms; zeromq ≤ 0.5 ms"),
    "pictures": Goal("a simulated camera, colour and depth of 640 × 480, ours ÷ MuJoCo", "≤ 1.3 ×"),
    "simulation": Goal("a simulated scene, ticks and laser scans, ours ÷ MuJoCo", "≤ 1.3 ×"),
    "publications": Goal("256 idle publications", "≤ 60 MB, ≤ 64 descriptors, ready in 1 s"),
    "clients": Goal("32 clients: calls ÷ those of 2; p99 ÷ raw; Jain's index", "≥ 1 ×; ≤ 1.6 ×; ≥ 0.9"),
    "mixed": Goal("p99 of quick calls beside a handler that takes 5 ms, ÷ without it", "≤ 2 ×"),
    "fanout": Goal("1 to 16 subscribers at 50 Hz: processor and p99 ÷ raw", "≤ 1.3 × each"),
    "arrivals": Goal("topics at 10 Hz: messages not accounted for", "none"),
    "start": Goal("start of a component, to `ready`", "≤ 0.3 s; dds ≤ 0.5 s"),
}
"""In the order of the table."""


@dataclass(frozen=True)
class Finding:
    """A finding for one goal and one `subject`; `case` distinguishes several of one subject.

    The guard compares `ratio`, if there is one. `value` orders the findings of a goal; without it, the ratio does.
    Greater is worse for both.
    """

    goal: str
    subject: str
    case: str
    shown: str
    met: bool
    ratio: float | None = None
    value: float | None = None

    @property
    def name(self) -> str:
        """Its unique name."""
        return " · ".join(filter(None, (self.goal, self.subject, self.case)))

    @property
    def badness(self) -> float:
        return self.value if self.value is not None else self.ratio if self.ratio is not None else math.inf


def failed(goal: str, subject: str, case: str = "") -> Finding:
    """A finding without a figure: the measurement failed."""
    return Finding(goal, subject, case, "failed", met=False)


def table(findings: Sequence[Finding]) -> Table:
    """One row for each goal: the best and the worst of its figures, and how many meet it."""
    cells = [
        (goal.what, goal.demand, *_summary([each for each in findings if each.goal == name]))
        for name, goal in GOALS.items()
    ]
    return Table("summary", "goals and results", ("what", "goal", "best", "worst", "met"), cells, labels=5)


def _summary(found: list[Finding]) -> tuple[str, str, str]:
    if not found:
        return "", "", "not measured"
    ranked = sorted(found, key=lambda each: each.badness)
    met = sum(each.met for each in found)
    return _shown(ranked[0]), _shown(ranked[-1]), "yes" if met == len(found) else f"{met} of {len(found)}"


def _shown(finding: Finding) -> str:
    return f"{finding.shown} ({' '.join(filter(None, (finding.subject, finding.case)))})"
