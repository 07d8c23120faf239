"""Generates the rescue network, runs it until its mission is over, and has it drawn.

python components/demo.py                        about a minute
python components/demo.py --fast                 the same story in ten seconds or so
python components/demo.py --middleware zeromq    over that middleware and no other
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from robocomp_py.cli import rcdeploy, rcgen
from robocomp_py.deploy.routes import stays_inside, unfit, unshared
from robocomp_py.runtime.settings import carrier, is_auto

NETWORK = Path(__file__).with_name("rescue.ddsl")
FAST = (
    "*.component.period=0.02",
    "world.component.period=0.01",
    "world.params.capacity=10",
    "world.params.battery=31",
    "rescue.params.enough=40",
)
"""Five times faster. A busy machine may keep the mission waiting while the robot drives
on for seconds: its battery lasts, and is low long before somebody can be met."""


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code of rcdeploy: 0 if somebody was found and help was called."""
    options = _parser().parse_args(arguments)
    picture = options.picture.resolve()
    carried = carrier(options.middleware, "zeromq")
    wrong = unfit(carried) or (
        unshared(carried, "world") if stays_inside(carried) else None
    )
    if wrong:  # before anything is generated for it
        print(f"demo.py: --middleware: {wrong}", file=sys.stderr)
        return 2
    over = ["--middleware", options.middleware] if options.middleware else []
    code = rcgen.main([str(NETWORK), *([] if is_auto(options.middleware) else over)])
    if code:
        return code
    given = ["--until", "rescue", "--set", f"world.params.picture={picture}"]
    if options.fast:
        given += [word for each in FAST for word in ("--set", each)]
    code = rcdeploy.main([str(NETWORK), *over, *given])
    if code == 0:
        print(f"The story is drawn in {picture}: open it in a browser.")
    return code


def _parser() -> argparse.ArgumentParser:
    summary, _, examples = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(
        description=summary,
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--middleware", help="what carries the messages")
    parser.add_argument("--fast", action="store_true", help="in ten seconds or so")
    parser.add_argument("--picture", type=Path, default=Path("rescue.svg"))
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
