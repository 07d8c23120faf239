"""Measures components, the bare libraries and other frameworks on this machine.

  start      a component, from its process to `ready`, and its memory then
  query      a call and its reply between two processes: ours and the bare library in turn
  counters   the same with and without the counters of operations
  peers      the same, compared with other frameworks that are installed (`make bench-peers`)
  publish    a reliable topic: one-way latency, and throughput
  loans      latency of messages that are filled in the memory that is sent
  records    100,000 points as records, compared with as many bytes and with a list of objects
  cpu        CPU time of components that are nearly idle
  placement  small messages with both processes on one core, and on two cores
  threads    handlers run by the thread that received the message, and by another one
  layers     the parts of a query's time; the codec of the cyclonedds package
  codecs     encoding and decoding alone, compared with the cyclonedds package and plain msgpack
  memory     queries with large arrays, if glibc keeps freed memory
  shared     memory in /dev/shm for messages of several sizes, and the part that is in use
  diary      processor time of an event of a diary
  record     `rc record`: processor, memory and lost messages at 180 MB/s
  virtual    the example network in virtual time
  lockstep   one instant of a network in lock-step
  pictures   a picture of a simulated camera, with its depth
  simulation ticks, laser scans, plans and edits of a simulated scene, and its component with cameras
  scale      cost of publications, clients, subscribers and sizes as a network grows
  languages  reading and checking files; `rc lint` and `rcgen` as processes
  lsp        from a change in an editor to its diagnostics
  tools      `rc list`, `rc echo`, looks of `rc monitor` and `rc top`, replay, re-run, a killed recorder, counters

Bare means: the same library, settings, socket kinds or QoS, router and encoded bytes, used in the fastest way
of its users, without our header. Trust ratios, not absolute figures: they are medians over short rounds taken in
turn. A quiet machine still gives better ones.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from . import (
    codecs,
    counters,
    cpu,
    diary,
    goals,
    languages,
    layers,
    loans,
    lockstep,
    lsp,
    machine,
    memory,
    pictures,
    placement,
    publish,
    query,
    recording,
    records,
    results,
    shared,
    simulation,
    start,
    threads,
    tools,
    versus,
    virtual,
)
from .goals import Finding
from .options import some_of, tell
from .parties import BY_NAME, FAILURES, MIDDLEWARES
from .rounds import FULL, QUICK, Effort
from .scale import scale
from .tables import Table, as_markdown, as_text, octets

MOST = 600.0
"""Seconds for one measurement, or more if more is demanded; the longest takes three minutes."""

SIZES = (64, 1024, 65536, 1_000_000, 6_000_000)


@dataclass
class Found:
    """The results of one measurement."""

    rows: list[Any]
    tables: list[Table]
    findings: list[Finding] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


Run = Callable[[argparse.Namespace, Effort], Found]


def main(arguments: Sequence[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, _terminated)
    base = QUICK if options.quick else FULL
    effort = Effort(options.rounds or base.rounds, options.seconds or base.seconds)
    if options.stored:
        for table in results.tables(results.load()):
            _print(table, options)
        return 0
    if options.draw:
        results.publish()
        return 0
    if options.write and options.only != MIDDLEWARES:
        print("--write stores the figures of all middlewares: leave --only out", file=sys.stderr)
        return 2
    here = machine.describe()
    _print(here, options)
    begun = time.monotonic()
    try:
        found, failures = _measure(options, effort)
    except KeyboardInterrupt:
        tell("")
        print("interrupted; what was started has been closed", file=sys.stderr)
        return 130
    findings = [each for one in found.values() for each in one.findings]
    if findings:
        _print(goals.table(findings), options)
    if options.json:
        about = {label: value for label, value in here.rows}
        rows = {what: [asdict(row) for row in one.rows] for what, one in found.items()}
        Path(options.json).write_text(json.dumps({"machine": about, **rows}, indent=1), encoding="utf-8")
    if options.write and not failures:
        tables = [here, *(table for one in found.values() for table in one.tables)]
        is_whole = set(options.what) == set(MEASUREMENTS)
        keep = results.store if is_whole else results.replace
        keep(tables, findings, {what: one.rows for what, one in found.items()})
        results.publish()
    minutes, seconds = divmod(round(time.monotonic() - begun), 60)
    print(f"\n{minutes} min {seconds} s", *failures, sep="\n", file=sys.stderr)
    return 1 if failures else 0


def _measure(options: argparse.Namespace, effort: Effort) -> tuple[dict[str, Found], list[str]]:
    """Measure and print all that was asked for. Returns the figures, and what failed."""
    found: dict[str, Found] = {}
    failures: list[str] = []
    for what in options.what:
        try:
            with _limited(MOST * max(1.0, effort.rounds * effort.seconds / FULL.rounds / FULL.seconds)):
                found[what] = MEASUREMENTS[what](options, effort)
        except Exception as exc:  # printed at once and at the end; the others are worth measuring all the same
            tell("")
            traceback.print_exc()
            failures.append(f"failed: {what}: {exc}")
            continue
        tell("")
        failures += [f"failed: {what}: {each}" for each in found[what].failures]
        for table in found[what].tables:
            _print(table, options)
    return found, failures


# What can be measured.


def _each(measure: Callable[..., list[Any]], middlewares: Sequence[str], effort: Effort) -> tuple[list[Any], list[str]]:
    """Measure one middleware after the other; a failure of one does not stop the others."""
    rows, failures = [], []
    for middleware in middlewares:
        try:
            rows += measure([middleware], effort, tell)
        except FAILURES as exc:
            failures.append(f"{middleware}: {exc}")
    return rows, failures


def _start(options: argparse.Namespace, effort: Effort) -> Found:
    rows, failures = _each(start.run, options.only, effort)
    return Found(rows, [start.table(rows)], start.findings(rows), failures)


def _query(options: argparse.Namespace, effort: Effort) -> Found:
    rows = query.run(options.only, options.sizes, effort, tell)
    return Found(rows, [query.table(rows)], query.findings(rows))


def _counters(options: argparse.Namespace, effort: Effort) -> Found:
    rows = counters.run(options.only, effort, tell)
    failures = [f"{row.middleware}: {row.failure}" for row in rows if row.failure]
    return Found(rows, [counters.table(rows)], counters.findings(rows), failures)


def _peers(options: argparse.Namespace, effort: Effort) -> Found:
    rows = versus.run(options.path, [versus.PEERS[name] for name in options.peers], options.sizes, effort, tell)
    return Found(rows, [versus.table(rows)], versus.findings(rows))


def _publish(options: argparse.Namespace, effort: Effort) -> Found:
    rows = publish.run(options.only, options.sizes, effort, tell)
    return Found(rows, publish.tables(rows), publish.findings(rows))


def _loans(options: argparse.Namespace, effort: Effort) -> Found:
    rows, failures = _each(loans.run, [each for each in ("shm", "inproc") if each in options.only], effort)
    return Found(rows, [loans.table(rows)], loans.findings(rows), failures)


def _cpu(options: argparse.Namespace, effort: Effort) -> Found:
    rows = cpu.run(options.only, effort, tell)
    return Found(rows, [cpu.table(rows)], cpu.findings(rows))


def _placement(options: argparse.Namespace, effort: Effort) -> Found:
    rows, failures = _each(placement.run, options.only, effort.halved)
    return Found(rows, [placement.table(rows)], failures=failures)


def _threads(options: argparse.Namespace, effort: Effort) -> Found:
    rows, failures = _each(threads.run, options.only, effort.halved)
    return Found(rows, [threads.table(rows)], failures=failures)


def _layers(options: argparse.Namespace, effort: Effort) -> Found:
    rows, failures = _each(layers.run, options.only, effort.halved)
    more = [layers.package_codec(effort.halved)] if "dds" in options.only else []
    return Found(rows, [layers.table(rows), *more], failures=failures)


def _codecs(options: argparse.Namespace, effort: Effort) -> Found:
    rows = codecs.run(effort.halved, tell)
    return Found(rows, [codecs.table(rows)], codecs.findings(rows))


def _diary(options: argparse.Namespace, effort: Effort) -> Found:
    rows = diary.run(effort, tell)
    return Found(rows, [diary.table(rows)])


def _records(options: argparse.Namespace, effort: Effort) -> Found:
    rows, failures = _each(records.run, options.only, effort.halved)
    return Found(rows, [records.table(rows)], records.findings(rows), failures=failures)


def _record(options: argparse.Namespace, effort: Effort) -> Found:
    rows = recording.run(options.only, effort, tell)
    failures = [f"{row.middleware} {row.compress}: {row.failure}" for row in rows if row.failure]
    return Found(rows, [recording.table(rows)], recording.findings(rows), failures)


def _memory(options: argparse.Namespace, effort: Effort) -> Found:
    rows, failures = _each(memory.run, options.only, effort.halved)
    return Found(rows, [memory.table(rows)], failures=failures)


def _shared(options: argparse.Namespace, effort: Effort) -> Found:
    rows = shared.run(effort.halved, tell) if "shm" in options.only else []
    return Found(rows, [shared.table(rows)], shared.findings(rows))


def _virtual(options: argparse.Namespace, effort: Effort) -> Found:
    rows = virtual.run(effort, tell)
    return Found(rows, [virtual.table(rows)], virtual.findings(rows))


def _pictures(options: argparse.Namespace, effort: Effort) -> Found:
    rows = pictures.run(effort, tell)
    return Found(rows, [pictures.table(rows)], pictures.findings(rows))


def _simulation(options: argparse.Namespace, effort: Effort) -> Found:
    rows = simulation.run(effort, tell)
    return Found(rows, [simulation.table(rows)], simulation.findings(rows))


def _lockstep(options: argparse.Namespace, effort: Effort) -> Found:
    rows, failures = _each(lockstep.run, options.only, effort)
    return Found(rows, [lockstep.table(rows)], lockstep.findings(rows), failures)


def _scale(options: argparse.Namespace, effort: Effort) -> Found:
    rows, failures = scale.run(options.only, effort, tell)
    return Found(rows, scale.tables(rows), scale.findings(rows), failures)


def _languages(options: argparse.Namespace, effort: Effort) -> Found:
    rows = languages.run(effort.halved, tell)
    return Found(rows, [languages.table(rows)])


def _lsp(options: argparse.Namespace, effort: Effort) -> Found:
    rows = lsp.run(effort.halved, tell)
    return Found(rows, [lsp.table(rows)])


def _tools(options: argparse.Namespace, effort: Effort) -> Found:
    rows = tools.run(options.only, effort.halved, tell)
    return Found(rows, [tools.table(rows)])


MEASUREMENTS: dict[str, Run] = {
    "start": _start,
    "query": _query,
    "counters": _counters,
    "peers": _peers,
    "publish": _publish,
    "loans": _loans,
    "records": _records,
    "diary": _diary,
    "cpu": _cpu,
    "placement": _placement,
    "threads": _threads,
    "layers": _layers,
    "codecs": _codecs,
    "memory": _memory,
    "shared": _shared,
    "record": _record,
    "virtual": _virtual,
    "lockstep": _lockstep,
    "pictures": _pictures,
    "simulation": _simulation,
    "scale": _scale,
    "languages": _languages,
    "lsp": _lsp,
    "tools": _tools,
}


# The command line.


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="examples:\n"
        "  python -m benchmarks --quick                              everything, roughly, in a minute or two\n"
        "  python -m benchmarks --what query --only dds,zenoh\n"
        "  python -m benchmarks --write                              everything; store it, update page and figures",
    )
    parser.add_argument(
        "--only",
        type=some_of((*MIDDLEWARES, *BY_NAME)),
        default=MIDDLEWARES,
        metavar="NAMES",
        help=f"middlewares, with commas between them: {', '.join((*MIDDLEWARES, *BY_NAME))} "
        f"(default: all but {', '.join(BY_NAME)})",
    )
    parser.add_argument(
        "--what",
        type=some_of(tuple(MEASUREMENTS)),
        default=tuple(MEASUREMENTS),
        metavar="WHAT",
        help=f"measurements: {', '.join(MEASUREMENTS)} (default: all)",
    )
    parser.add_argument(
        "--sizes",
        type=_sizes,
        default=SIZES,
        metavar="BYTES",
        help=f"of the array, from 8 (default: {','.join(map(str, SIZES))})",
    )
    parser.add_argument(
        "--peers",
        type=some_of(tuple(versus.PEERS)),
        default=tuple(versus.PEERS),
        metavar="NAMES",
        help=f"other frameworks: {', '.join(versus.PEERS)} (default: all)",
    )
    parser.add_argument(
        "--path",
        choices=MIDDLEWARES,
        default="shm",
        help="what ours uses beside other frameworks (default: shm, which `auto` takes on one host)",
    )
    parser.add_argument("--quick", action="store_true", help="few and short rounds: a first impression")
    parser.add_argument("--rounds", type=int, metavar="N", help=f"rounds per figure (default: {FULL.rounds})")
    parser.add_argument(
        "--seconds", type=float, metavar="S", help=f"per round and party, about (default: {FULL.seconds:g})"
    )
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    parser.add_argument(
        "--write",
        action="store_true",
        help="store the results of what was measured, and update the page and its figures",
    )
    parser.add_argument("--draw", action="store_true", help="measure nothing: update page and figures as stored")
    parser.add_argument("--stored", action="store_true", help="measure nothing: print the stored tables")
    parser.add_argument(
        "--json",
        metavar="FILE",
        help="write all figures there, times in µs (of `start`, `languages`, `lsp` and `tools`: in s)",
    )
    return parser


def _sizes(text: str) -> tuple[int, ...]:
    try:
        sizes = tuple(map(int, text.split(",")))
    except ValueError:
        raise argparse.ArgumentTypeError(f"`{text}`: write numbers of bytes, as in 64,1000000") from None
    if min(sizes) < 8:
        raise argparse.ArgumentTypeError(f"{octets(min(sizes))}: a message has at least 8 bytes, for a time")
    return sizes


def _print(table: Table, options: argparse.Namespace) -> None:
    shown = f"**{table.title}**\n\n{as_markdown(table)}" if options.markdown else as_text(table)
    print(f"\n{shown}", flush=True)


@contextlib.contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise TimeoutError after this time, because a benchmark may run unattended."""

    def ended(number: int, frame: object) -> None:
        raise TimeoutError(f"not done after {seconds:g} s")

    before = signal.signal(signal.SIGALRM, ended)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _terminated(number: int, frame: object) -> None:
    raise SystemExit(128 + number)  # closes everything on the way out
