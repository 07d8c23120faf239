"""A guard against regressions: ratios measured in short rounds, compared with those of `baseline.json`.

It compares ratios of ours to the bare library, because they are similar on every machine, even a busy one. A ratio
that has grown by more than its tolerance is measured again, up to three times, and the best one counts. Only a ratio
that stays too large is reported. `--write` makes this version the new baseline.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from . import codecs, counters, loans, publish, query, start
from .goals import Finding
from .options import some_of, tell
from .parties import MIDDLEWARES
from .rounds import Effort, by_turns, how_many, ratio, seconds_of
from .tables import Table, as_text, times_as_much

BASELINE = Path(__file__).with_name("baseline.json")
SIZES = (64, 1_000_000)
EFFORT = Effort(9, 0.03)
AGAIN = 3

TOLERANCES = {
    "small": 1.2,
    "large": 1.25,
    "inproc": 1.3,
    "counters": 1.1,
    "latency": 1.4,
    "rate": 1.4,
    "loan": 1.5,
    "start": 1.3,
    "xcdr1": 2.0,
    "messagepack": 2.0,
}
"""By goal: how much a ratio may grow before that is no longer chance."""

TO_RAW = ("small", "large", "latency", "rate", "counters")
"""For these, a ratio below 1 was luck, and counts as 1."""


@dataclass(frozen=True)
class Probe:
    """One measurement of one middleware, which can be repeated alone."""

    what: str
    middleware: str
    measure: Callable[[Effort], list[Finding]]


@dataclass(frozen=True)
class Row:
    name: str
    before: float | None
    """None: never measured before."""
    found: float | None
    """None: it could not be measured now."""

    @property
    def allowed(self) -> float | None:
        if self.before is None:
            return None
        goal = self.name.partition(" · ")[0]
        return (max(1.0, self.before) if goal in TO_RAW else self.before) * TOLERANCES[goal]

    @property
    def regressed(self) -> bool:
        return self.allowed is not None and (self.found is None or self.found > self.allowed)


def main(arguments: Sequence[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    effort = Effort(options.rounds or EFFORT.rounds, options.seconds or EFFORT.seconds)
    chosen = [probe for probe in probes(options.only) if probe.what in options.what]
    baseline = Path(options.baseline)
    if options.write:
        found = _medians([_ratios(chosen, effort) for _ in range(AGAIN)])
        earlier = json.loads(baseline.read_text(encoding="utf-8")) if baseline.exists() else {}
        text = json.dumps(
            earlier | {name: float(f"{value:.3g}") for name, value in found.items()},
            indent=1,
            sort_keys=True,
            ensure_ascii=False,
        )
        baseline.write_text(f"{text}\n", encoding="utf-8")
        return 0
    before: dict[str, float] = json.loads(baseline.read_text(encoding="utf-8"))
    rows = compare(before, chosen, effort)
    tell("")
    print(as_text(table(rows)))
    if any(row.regressed for row in rows):
        print("\nslower than it was, in each of several attempts; if that is meant: --write", file=sys.stderr)
        return 1
    return 0


def compare(before: dict[str, float], chosen: Sequence[Probe], effort: Effort) -> list[Row]:
    """New findings beside earlier ones; those that seem worse are measured again."""
    best: dict[str, float] = {}
    suspects = list(chosen)
    for _ in range(1 + AGAIN):
        for probe in suspects:
            for name, value in _ratios([probe], effort).items():
                best[name] = min(value, best.get(name, value))
        rows = [Row(name, before.get(name), best.get(name)) for name in sorted(before.keys() | best.keys())]
        regressed = {row.name for row in rows if row.regressed}
        suspects = [probe for probe in chosen if any(_belongs(name, probe) for name in regressed)]
        if not suspects:
            break
    return [row for row in rows if any(_belongs(row.name, probe) for probe in chosen)]


def _belongs(name: str, probe: Probe) -> bool:
    """Whether this probe finds a figure of this name."""
    goal, subject, *_ = name.split(" · ")
    return goal in GOALS_OF[probe.what] and (not probe.middleware or probe.middleware == subject)


def _ratios(chosen: Iterable[Probe], effort: Effort) -> dict[str, float]:
    found = [each for probe in chosen for each in probe.measure(effort)]
    return {each.name: each.ratio for each in found if each.ratio is not None}


def _medians(runs: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: statistics.median(run[name] for run in runs if name in run) for name in runs[0]}


# The probes.

GOALS_OF = {
    "query": ("small", "large", "inproc"),
    "counters": ("counters",),
    "publish": ("latency", "rate"),
    "loans": ("loan",),
    "codecs": ("xcdr1", "messagepack"),
    "start": ("start",),
}


def probes(middlewares: Sequence[str]) -> list[Probe]:
    made = [Probe("codecs", "", _codecs)]
    for each in middlewares:
        if each == "inproc":
            made.append(Probe("query", each, _inproc))
        else:
            made.append(Probe("query", each, partial(_query, each)))
            made.append(Probe("publish", each, partial(_publish, each)))
        if each in counters.MEASURED:
            made.append(Probe("counters", each, partial(_counters, each)))
        if each == "shm":
            made.append(Probe("loans", each, partial(_loans, each)))
        made.append(Probe("start", each, partial(_start, each)))
    return made


def _query(middleware: str, effort: Effort) -> list[Finding]:
    return query.findings(query.run([middleware], SIZES, effort, tell))


def _counters(middleware: str, effort: Effort) -> list[Finding]:
    return counters.findings(counters.run([middleware], effort, tell))


def _publish(middleware: str, effort: Effort) -> list[Finding]:
    return publish.findings(publish.run([middleware], SIZES, effort, tell))


def _loans(middleware: str, effort: Effort) -> list[Finding]:
    return loans.findings(loans.run([middleware], effort, tell))


def _codecs(effort: Effort) -> list[Finding]:
    return codecs.findings(codecs.run(Effort(3, effort.seconds), tell))


def _start(middleware: str, effort: Effort) -> list[Finding]:
    return start.findings(start.run([middleware], Effort(3, effort.seconds), tell))


def _inproc(effort: Effort) -> list[Finding]:
    """There is no bare library, so a query is compared with a piece of plain Python."""
    tell("query · inproc")
    with query.both("inproc", 10) as pairs:
        ask = partial(pairs[0].near.ask, query.some(64))
        calls = (ask, _piece_of_python)
        measures = [partial(seconds_of, call, how_many(call, effort.seconds)) for call in calls]
        ours, piece = by_turns(measures, effort.rounds)
    found = ratio(ours, piece)
    return [Finding("inproc", "inproc", "", times_as_much(found), True, found)]


def _piece_of_python() -> object:
    return [number * 3 % 7 for number in range(100)]


def table(rows: Sequence[Row]) -> Table:
    cells = [
        (
            row.name,
            *("–" if each is None else f"{each:.3g} ×" for each in (row.before, row.allowed, row.found)),
            "new" if row.before is None else "regressed" if row.regressed else "",
        )
        for row in rows
    ]
    return Table("check", "ratios, then and now", ("", "then", "allowed", "now", ""), cells, labels=1)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.check", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, known, what in (("only", MIDDLEWARES, "middlewares"), ("what", tuple(GOALS_OF), "measurements")):
        parser.add_argument(
            f"--{name}",
            type=some_of(known),
            default=known,
            metavar="NAMES",
            help=f"{what}, with commas between them: {', '.join(known)} (default: all)",
        )
    parser.add_argument("--rounds", type=int, metavar="N", help=f"rounds per figure (default: {EFFORT.rounds})")
    parser.add_argument("--seconds", type=float, metavar="S", help=f"per round and party (default: {EFFORT.seconds:g})")
    parser.add_argument("--baseline", default=BASELINE, metavar="FILE", help="what to compare with, or to write")
    parser.add_argument("--write", action="store_true", help="measure three times, and write the medians there")
    return parser
