"""`rcdeploy logs`: what the components of a network have printed."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from ..common import FINE, USAGE, complain, raise_if_signalled, raise_if_unread, sleep_while_read
from ..completing import What, completed
from ..logged import add_filters, wanted
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
  rcdeploy logs net.ddsl rc-mcp -f    what an agent does, through rc mcp
  rcdeploy logs net.ddsl --level warning --since 10m    warnings and errors of the last ten minutes
  rcdeploy logs net.ddsl --grep 'lost|late' -f          lines with one of these words, and new ones as they come
  rcdeploy logs net.ddsl --json                         an object a line: time, level, instance, file, text and more

Each line has its time; lines of an earlier day have the date, too. A traceback belongs to its log record, so it is
chosen and counted as one line. --level leaves out what is no log record. For a network that is not running, the command
shows the output of its newest run, also from a --log-dir; there, file and thread of a record are kept by
`rcdeploy --record-logs json` only.
Exit status: 0 fine, 1 the network is not running and has left no logs, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Show what the components of a network have printed.", _EXAMPLES
    add_network(to)
    about = "an instance, a process or a system (default: all)"
    completed(to.add_argument("names", nargs="*", metavar="INSTANCE", help=about), What.INSTANCE)
    to.add_argument("-f", "--follow", action="store_true", help="keep printing new lines as they come")
    add_filters(to)
    to.add_argument("--json", action="store_true", help="print an object a line, for machines")
    to.add_argument("-n", "--lines", type=_count, default=100, metavar="N", help="how many lines (default: 100)")


def run(options: argparse.Namespace) -> int:
    return connected(options.network, lambda connection: _print(connection, options), lambda: _print_past(options))


def _print(connection: Connection, options: argparse.Namespace) -> int:
    from ...deploy.logs import AGENT

    if AGENT in options.names:
        return _print_agent(connection, options)
    _show(_lines(connection, options.names, options), as_json=options.json)
    return FINE


def _lines(connection: Connection, names: Sequence[str], options: argparse.Namespace) -> Iterable[Line]:
    from ...deploy.client import chosen_lines, lines

    count, follow = options.lines, options.follow
    connection.meanwhile = raise_if_unread
    if wanted(options).everything:
        return lines(connection, names, count, follow=follow)
    return chosen_lines(connection, names, count, _is_wanted(options), follow=follow)


def _print_agent(connection: Connection, options: argparse.Namespace) -> int:
    """Print what `rc mcp` has written, which rcdeploy does not keep, and what the others have printed."""
    from ...deploy.logs import AGENT, growing_lines, logged_names, past_lines
    from ...deploy.place import Place, Run

    place = Place(connection.network)
    run = place.last_run() or Run(place.logs, 0.0)
    names = [each for each in options.names if each != AGENT]
    if not logged_names(run.logs, [AGENT]):
        return complain(f"rcdeploy: no `rc mcp` has been started for this run of {connection.network}")
    if options.follow and names:
        complain(f"rcdeploy: the log of {AGENT} is followed alone; leave out {', '.join(names)}")
        return USAGE
    count, choice = options.lines, _is_wanted(options)
    if options.follow:

        def goes_on() -> bool:
            sleep_while_read(_LOOK_S)
            raise_if_signalled()
            return place.runner() is not None

        _show(growing_lines(run.logs, AGENT, count, run.began, choice, goes_on), as_json=options.json)
        return FINE
    found = past_lines(run.logs, [AGENT], count, run.began, choice)
    found += _lines(connection, names, options) if names else []
    found = sorted(found, key=lambda line: line.at)[-count:] if count else []
    _show(found, as_json=options.json)
    return FINE


_LOOK_S = 0.2
"""Seconds between two looks for new lines in a file."""


def _is_wanted(options: argparse.Namespace) -> Callable[[Line], bool]:
    choice = wanted(options)
    return lambda line: choice(line.at, line.level, line.message)


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
    everything = wanted(options).everything
    past = past_lines(run.logs, options.names, options.lines, run.began, None if everything else _is_wanted(options))
    if not past and options.lines:
        of = "" if everything else " of this kind"
        print(f"{', '.join(options.names) or network} printed nothing{of} in that run", file=sys.stderr)
    _show(past, as_json=options.json)
    return FINE


def _show(lines: Iterable[Line], *, as_json: bool) -> None:
    if as_json:
        _show_as_json(lines)
    else:
        _show_as_text(lines)


def _show_as_json(lines: Iterable[Line]) -> None:
    from ...deploy.logs import told

    for line in lines:
        print(json.dumps(told(line)), flush=True)
        raise_if_signalled()


def _show_as_text(lines: Iterable[Line]) -> None:
    from ...deploy.table import clock_time, full_time

    width, today = 0, full_time(time.time())[:10]
    for line in lines:
        width = max(width, len(line.name))
        when = clock_time(line.at) if full_time(line.at).startswith(today) else full_time(line.at)
        style = "cyan" if line.name != "rcdeploy" else "bold"
        for text in line.text.split("\n"):
            show([(f"{when} ", "dim"), (f"{line.name:>{width}} | ", style), (text, "")])
        sys.stdout.flush()
        raise_if_signalled()


def _count(text: str) -> int:
    from ...deploy.ring import MOST_LINES

    if not text.isdecimal() or int(text) > MOST_LINES:
        raise argparse.ArgumentTypeError(f"`{text}` is not a number of lines from 0 to {MOST_LINES}")
    return int(text)
