"""`make faults`: run the matrix, print one table, and exit with 1 if something did not hold."""

from __future__ import annotations

import argparse
import random
import signal
import sys
import time
import traceback
from collections.abc import Iterable, Sequence

from . import attacks, calls, memory, network, networks, report, routers, scarcity, starts, surroundings, topics
from . import frames as about_frames
from .rows import Row, Run

ROWS: list[Row] = [
    *calls.ROWS,
    *topics.ROWS,
    *starts.ROWS,
    *about_frames.ROWS,
    *memory.ROWS,
    *surroundings.ROWS,
    *scarcity.ROWS,
    *network.ROWS,
    *networks.ROWS,
    *routers.ROWS,
    *attacks.ROWS,
]

_REDUCED = 0.11
"""How long a few rounds take, of the whole row."""


def main(arguments: Sequence[str] | None = None) -> int:
    options = _parsed(arguments)
    chosen = [(row, each) for row in _rows(options) for each in row.transports if each in (options.over or [each])]
    if not chosen:
        print("nothing to do: no such row over that middleware; rows: " + ", ".join(row.name for row in ROWS))
        return 2
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what `nohup`, or `&` in a script, has ignored would be
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored by what we start, too, and then it does not end by that
    full = not options.reduced
    expected = sum(row.lasts(options.frames) for row, _ in chosen) * (1.0 if full else _REDUCED)
    print(f"{len(chosen)} runs, about {expected / 60:.0f} minutes; seed {options.seed}", flush=True)
    found = [_run(row, transport, options.seed, full, options.frames) for row, transport in chosen]
    print()
    print(report.table(found))
    if options.write:
        report.write_page(found, ROWS, options.seed)
    missed = [each for each in found if each.misses]
    if missed:
        rows = [f"--only {name}" for name in sorted({each.row.name for each in missed})]
        over = [f"--over {name}" for name in sorted({each.transport for each in missed})]
        repeated = " ".join([*rows, *over, f"--seed {options.seed}", *(["--reduced"] if options.reduced else [])])
        print(f"\n{len(missed)} of {len(found)} missed; once more: python -m tests.faults {repeated}")
    return 1 if missed else 0


def _run(row: Row, transport: str, seed: int, full: bool, frames: int) -> report.Found:
    def tell(what: str) -> None:
        print(f"  {row.name} over {transport}: {what}", flush=True)

    print(f"{row.name} over {transport}: {row.fault}", flush=True)
    begun = time.monotonic()
    result, why = None, ""
    try:
        result = row.run(Run(transport, seed, full, tell, frames))
    except Exception as exc:  # the other rows are run all the same
        traceback.print_exc()
        why = f"{type(exc).__name__}: {str(exc).splitlines()[0] if str(exc) else ''}"
    found = report.Found(row, transport, result, why, time.monotonic() - begun, timed=full)
    for miss in found.misses[:5]:
        print(f"  MISSED: {miss}", flush=True)
    return found


def _rows(options: argparse.Namespace) -> Iterable[Row]:
    for row in ROWS:
        if (not options.only or row.name in options.only) and (row.reduced or not options.reduced):
            yield row


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    names = [row.name for row in ROWS]
    parser.add_argument("--only", action="append", choices=names, metavar="ROW", help=", ".join(names))
    parser.add_argument("--over", action="append", metavar="MIDDLEWARE", help="only over these")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6), help="repeat a run")
    parser.add_argument("--reduced", action="store_true", help="a few rounds of each; no times are judged")
    parser.add_argument("--frames", type=int, default=0, metavar="N", help="number of malformed frames")
    parser.add_argument("--write", action="store_true", help="write what is found to docs/explanation/fault-matrix.md")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
