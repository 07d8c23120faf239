"""`rcdeploy logs`: what the components of a network have printed."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable
from typing import TYPE_CHECKING

from ..common import FINE, complain, raise_if_signalled
from .connected import add_network, connected, show

if TYPE_CHECKING:
    from ...deploy.client import Connection
    from ...deploy.ring import Line

NAME = "logs"
HELP = "show what the components of a network have printed"

_EXAMPLES = """\
examples:
  rcdeploy logs net.ddsl              the last lines of all, in the order in which they came
  rcdeploy logs net.ddsl laser -n 20  ... twenty of one instance
  rcdeploy logs net.ddsl -f           ... and new lines as they come, until Ctrl-C or the network ends
  rcdeploy logs net.ddsl rcdeploy     the messages of rcdeploy itself

Each line has its time; lines of an earlier day have the date, too. For a network that is not running, the command
shows the output of its newest run, also from a --log-dir.
Exit status: 0 fine, 1 the network is not running and has left no logs, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Show what the components of a network have printed.", _EXAMPLES
    add_network(to)
    to.add_argument("names", nargs="*", metavar="INSTANCE", help="an instance, a process or a system (default: all)")
    to.add_argument("-f", "--follow", action="store_true", help="keep printing new lines as they come")
    to.add_argument("-n", "--lines", type=_count, default=100, metavar="N", help="how many lines (default: 100)")


def run(options: argparse.Namespace) -> int:
    return connected(options.network, lambda connection: _print(connection, options), lambda: _print_past(options))


def _print(connection: Connection, options: argparse.Namespace) -> int:
    from ...deploy.client import lines

    _show(lines(connection, options.names, options.lines, follow=options.follow))
    return FINE


def _print_past(options: argparse.Namespace) -> int | None:
    """Print the logs of a network's last run; None if there are none."""
    from ...deploy.client import network_of
    from ...deploy.logs import logged_names, past_lines
    from ...deploy.place import Place, Run

    network = network_of(options.network)
    place = Place(network)
    run = place.last_run() or Run(place.logs, 0.0)
    there = logged_names(run.logs)
    if not there:
        if run.began:
            return complain(f"rcdeploy: {network} is not running, and its last logs in {run.logs} have been removed")
        return None
    unknown = [name for name in options.names if not logged_names(run.logs, [name])]
    if unknown:
        return complain(
            f"rcdeploy: {network} is not running, and {run.logs} has no logs of {', '.join(unknown)}; "
            f"it has logs of: {', '.join(there)}"
        )
    print(f"{network} is not running; these are the logs of its last run, from {run.logs}", file=sys.stderr)
    past = past_lines(run.logs, options.names, options.lines, run.began)
    if not past and options.lines:
        print(f"{', '.join(options.names) or network} printed nothing in that run", file=sys.stderr)
    _show(past)
    return FINE


def _show(lines: Iterable[Line]) -> None:
    from ...deploy.table import clock_time, full_time

    width, today = 0, full_time(time.time())[:10]
    for at, name, text in lines:
        width = max(width, len(name))
        when = clock_time(at) if full_time(at).startswith(today) else full_time(at)
        show([(f"{when} ", "dim"), (f"{name:>{width}} | ", "cyan" if name != "rcdeploy" else "bold"), (text, "")])
        sys.stdout.flush()
        raise_if_signalled()


def _count(text: str) -> int:
    from ...deploy.control import MOST_LINES

    if not text.isdecimal() or int(text) > MOST_LINES:
        raise argparse.ArgumentTypeError(f"`{text}` is not a number of lines from 0 to {MOST_LINES}")
    return int(text)
