"""How fast it is, beside the raw libraries, measured here and now.

  query    a question and its answer, between two processes: ours and the bare library by turns
  publish  a reliable topic: latency one way, and what gets through
  start    a component, from its process to `ready`
  layers   where the time of a query goes; the codec of the cyclonedds package
  memory   queries with large arrays, when glibc keeps freed memory
  languages  files read and checked; `rc lint` and `rcgen` as processes
  lsp      from a change in an editor to its diagnostics

Bare means: the same library, settings, socket kinds or QoS, router and encoded bytes, coded by the
fastest way a user of it would take, without our header. Ratios count, not absolute figures: they are
medians over short rounds taken by turns. A quiet machine still gives better ones.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from . import languages, layers, lsp, machine, memory, publish, query, start
from .parties import MIDDLEWARES
from .rounds import FULL, QUICK, Effort
from .tables import Table, as_markdown, as_text, fill, octets

SIZES = (64, 1024, 65536, 1_000_000, 6_000_000)
Rows = list[Any]
Run = Callable[[argparse.Namespace, Effort], tuple[Rows, list[Table]]]


def main(arguments: Sequence[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, _terminated)
    base = QUICK if options.quick else FULL
    effort = Effort(options.rounds or base.rounds, options.seconds or base.seconds)
    tables, found = [machine.describe()], {}
    if options.page:
        page = Path(options.page)
        text = fill(page.read_text(encoding="utf-8"), tables)  # now: who named a wrong page should not wait to hear
    print(_shown(tables[0], options), flush=True)
    try:
        for what in options.what:
            found[what], new = MEASUREMENTS[what](options, effort)
            _tell("")
            tables += new
            for table in new:
                print(f"\n{_shown(table, options)}", flush=True)
    except KeyboardInterrupt:
        _tell("")
        print("interrupted; what was started has been closed", file=sys.stderr)
        return 130
    if options.json:
        about = {label: value for label, value in tables[0].rows}
        rows = {what: [asdict(row) for row in rows] for what, rows in found.items()}
        Path(options.json).write_text(json.dumps({"machine": about, **rows}, indent=1), encoding="utf-8")
    if options.page:
        page.write_text(fill(text, tables), encoding="utf-8")
    return 0


# What can be measured.


def _query(options: argparse.Namespace, effort: Effort) -> tuple[Rows, list[Table]]:
    rows = query.run(options.only, options.sizes, effort, _tell)
    return rows, [query.table(rows)]


def _publish(options: argparse.Namespace, effort: Effort) -> tuple[Rows, list[Table]]:
    rows = publish.run(options.only, options.sizes, effort, _tell)
    return rows, publish.tables(rows)


def _start(options: argparse.Namespace, effort: Effort) -> tuple[Rows, list[Table]]:
    rows = start.run(options.only, effort, _tell)
    return rows, [start.table(rows)]


def _layers(options: argparse.Namespace, effort: Effort) -> tuple[Rows, list[Table]]:
    rows = layers.run(options.only, effort, _tell)
    more = [layers.package_codec(effort)] if "dds" in options.only else []
    return rows, [layers.table(rows), *more]


def _memory(options: argparse.Namespace, effort: Effort) -> tuple[Rows, list[Table]]:
    rows = memory.run(options.only, effort, _tell)
    return rows, [memory.table(rows)]


def _languages(options: argparse.Namespace, effort: Effort) -> tuple[Rows, list[Table]]:
    rows = languages.run(effort, _tell)
    return rows, [languages.table(rows)]


def _lsp(options: argparse.Namespace, effort: Effort) -> tuple[Rows, list[Table]]:
    rows = lsp.run(effort, _tell)
    return rows, [lsp.table(rows)]


MEASUREMENTS: dict[str, Run] = {
    "start": _start,
    "query": _query,
    "publish": _publish,
    "layers": _layers,
    "memory": _memory,
    "languages": _languages,
    "lsp": _lsp,
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
        "  python -m benchmarks --page docs/performance.md           everything, and into that page",
    )
    parser.add_argument(
        "--only",
        type=_some_of(MIDDLEWARES),
        default=MIDDLEWARES,
        metavar="NAMES",
        help=f"middlewares, with commas between them: {', '.join(MIDDLEWARES)} (default: all)",
    )
    parser.add_argument(
        "--what",
        type=_some_of(tuple(MEASUREMENTS)),
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
    parser.add_argument("--quick", action="store_true", help="few and short rounds: a first impression")
    parser.add_argument("--rounds", type=int, metavar="N", help=f"rounds per figure (default: {FULL.rounds})")
    parser.add_argument(
        "--seconds", type=float, metavar="S", help=f"per round and party, about (default: {FULL.seconds:g})"
    )
    parser.add_argument("--markdown", action="store_true", help="print Markdown")
    parser.add_argument("--page", metavar="FILE", help="write the tables into this page, between its marks")
    parser.add_argument(
        "--json", metavar="FILE", help="write all figures there, times in µs (of `start`, `languages` and `lsp`: in s)"
    )
    return parser


def _some_of(known: tuple[str, ...]) -> Callable[[str], tuple[str, ...]]:
    def chosen(text: str) -> tuple[str, ...]:
        names = tuple(text.split(","))
        for name in names:
            if name not in known:
                raise argparse.ArgumentTypeError(f"no `{name}`; there are {', '.join(known)}")
        return names

    return chosen


def _sizes(text: str) -> tuple[int, ...]:
    try:
        sizes = tuple(map(int, text.split(",")))
    except ValueError:
        raise argparse.ArgumentTypeError(f"`{text}`: write numbers of bytes, as in 64,1000000") from None
    if min(sizes) < 8:
        raise argparse.ArgumentTypeError(f"{octets(min(sizes))}: a message has at least 8 bytes, for a time")
    return sizes


def _shown(table: Table, options: argparse.Namespace) -> str:
    return f"**{table.title}**\n\n{as_markdown(table)}" if options.markdown else as_text(table)


def _tell(text: str) -> None:
    """How far it is, on one line if somebody looks at it."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
    elif text:
        print(text, file=sys.stderr, flush=True)


def _terminated(number: int, frame: object) -> None:
    raise SystemExit(128 + number)  # so that everything is closed on the way out


if __name__ == "__main__":
    sys.exit(main())
