"""`rcdeploy logs`: what the components of a network have printed."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from ..common import FINE
from .asking import add_network, asking, show

if TYPE_CHECKING:
    from ...deploy.client import Connection

NAME = "logs"
HELP = "show what the components of a network have printed"

_EXAMPLES = """\
examples:
  rcdeploy logs net.ddsl              the last lines of all, in the order in which they came
  rcdeploy logs net.ddsl laser -n 20  ... twenty of one instance
  rcdeploy logs net.ddsl -f           ... and what comes then, until Ctrl-C or the end of the network
  rcdeploy logs net.ddsl rcdeploy     what rcdeploy itself had to say

exit status: 0 fine, 1 the network does not run, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Show what the components of a network have printed.", _EXAMPLES
    add_network(to)
    to.add_argument("names", nargs="*", metavar="INSTANCE", help="an instance, a process or a system (default: all)")
    to.add_argument("-f", "--follow", action="store_true", help="go on with what they print from now on")
    to.add_argument("-n", "--lines", type=_count, default=100, metavar="N", help="how many lines (default: 100)")


def run(options: argparse.Namespace) -> int:
    return asking(options.network, lambda connection: _print(connection, options))


def _print(connection: Connection, options: argparse.Namespace) -> int:
    from ...deploy.client import lines

    width = 0
    for name, text in lines(connection, options.names, options.lines, follow=options.follow):
        width = max(width, len(name))
        show([(f"{name:>{width}} | ", "cyan" if name != "rcdeploy" else "bold"), (text, "")])
        sys.stdout.flush()
    return FINE


def _count(text: str) -> int:
    from ...deploy.control import MOST_LINES

    if not text.isdecimal() or int(text) > MOST_LINES:
        raise argparse.ArgumentTypeError(f"`{text}` is no number of lines from 0 to {MOST_LINES}")
    return int(text)
