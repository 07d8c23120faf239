"""Generate, run and measure one component over each middleware. Ends with 1 if its own code did not keep its bytes."""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ..tables import Table, as_text, fill, us
from .project import copy, differing, generate, run, sha256, specific

MIDDLEWARES = "ice", "zeromq", "dds", "zenoh", "shm", "inproc"
HEAD = "middleware", "specific files, SHA-256", "files that the switch changed", "round trip, p50"


def main(arguments: Sequence[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    chosen = options.only or MIDDLEWARES
    times: dict[str, list[float]] = {each: [] for each in chosen}
    with tempfile.TemporaryDirectory(prefix="middleware-switch-") as scratch:
        root = Path(scratch, "project")
        copy(root)
        first = generate(root, chosen[0])
        last, own, changed = first, {}, {}
        for middleware in chosen:
            now = generate(root, middleware)
            own[middleware] = sha256(specific(now))
            changed[middleware] = differing(last, now)
            last = now
        for _ in range(options.rounds):
            for middleware in chosen:
                print(f"{middleware} …", file=sys.stderr)
                generate(root, middleware)
                times[middleware].append(run(root, middleware))
        back = generate(root, chosen[0])
    foreign = sorted({path for paths in changed.values() for path in paths if "generic" not in Path(path).parts})
    kept = back == first and len(set(own.values())) == 1 and not foreign
    rows = [
        (each, own[each][:16], _listed(changed[each]), us(statistics.median(times[each])) if times[each] else "–")
        for each in chosen
    ]
    note = f"Back to {chosen[0]}: " + ("every file is what it was." if kept else "NOT every file is what it was.")
    table = Table("switch", "One component over every middleware", HEAD, rows, labels=3, note=note)
    print(as_text(table))
    if foreign:
        print("changed, and not generic: " + ", ".join(foreign))
    if options.page:
        options.page.write_text(fill(options.page.read_text(), [table]))
    return 0 if kept else 1


def _listed(paths: set[str]) -> str:
    """How many, and in which folders."""
    folders = sorted({str(Path(path).parent) for path in paths})
    return f"{len(paths)}: {', '.join(folders)}" if paths else "none: the first one"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.middleware_switch", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=MIDDLEWARES, metavar="NAME", help=f"of {', '.join(MIDDLEWARES)}")
    parser.add_argument("--rounds", type=int, default=5, help="how often each is run (default: 5); the median counts")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the table into this page")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
