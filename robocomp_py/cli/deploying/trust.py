"""`rcdeploy trust`: remember the key of a host, after somebody has looked at it."""

from __future__ import annotations

import argparse

from ..common import complain

NAME = "trust"
HELP = "remember the SSH key of a host"

_EXAMPLES = """\
examples:
  rcdeploy trust 192.168.1.10           show the key of a host, ask, and remember it
  rcdeploy trust robot@onboard:2222     ... of one at another port

exit status: 0 fine, 1 refused, 2 usage, 3 the host cannot be reached
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Show the SSH key of a host, ask, and remember it.", _EXAMPLES
    to.add_argument("host", metavar="HOST", help="[USER@]ADDRESS[:PORT]")


def run(options: argparse.Namespace) -> int:
    return complain("rcdeploy trust: not in this version")  # SEAM for E: call deploy/hosts here
