"""`rcdeploy up`: start a network, watch it, stop it."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from ..common import FINE, USAGE, complain
from .planning import add_network, planned

if TYPE_CHECKING:
    from ...deploy.plan import Plan

NAME = "up"
HELP = "start a network; what `rcdeploy NET.ddsl` does"

_EXAMPLES = """\
examples:
  rcdeploy up net.ddsl                              start everything; Ctrl-C stops it, twice kills it
  rcdeploy up net.ddsl --for 30                     ... for half a minute
  rcdeploy up net.ddsl --until mission              ... until that instance ends
  rcdeploy up net.ddsl --middleware zeromq          ... over that middleware and no other
  rcdeploy up net.ddsl --set world.params.step=0.1  set a key of an instance's configuration (*: of all)

exit status: 0 fine, 1 wrong input or something failed, 2 usage, 130/143 stopped by a signal
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Check a network, start it in order, watch it, and stop it.", _EXAMPLES
    add_network(to)
    add_options(to)


def add_options(to: argparse.ArgumentParser) -> None:
    """All options but those that change the network."""
    to.add_argument(
        "--for", dest="duration", type=_seconds, metavar="SECONDS", help="stop so long after everything was ready"
    )
    to.add_argument("--until", metavar="INSTANCE", help="stop everything when this one ends")


def run(options: argparse.Namespace) -> int:
    plan = planned(options)
    if isinstance(plan, int):
        return plan
    ending = {name for process in plan.processes for name in (process.name, *process.instances)}
    if options.until and options.until not in ending:
        print(f"rcdeploy: --until {options.until}: there is no such instance", file=sys.stderr)
        return USAGE
    return _run(plan, options)


def _run(plan: Plan, options: argparse.Namespace) -> int:
    from ...deploy.run import Options
    from ...deploy.terminal import run_on_terminal
    from ...errors import ConfigurationError, TransportError

    if not plan.processes:
        return FINE
    try:
        return run_on_terminal(plan, Options(options.duration, options.until))
    except (TransportError, ConfigurationError) as exc:
        return complain(f"rcdeploy: {exc}")


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"`{text}` is no number of seconds; write it as in --for 30 or --for 0.5")
    return value
