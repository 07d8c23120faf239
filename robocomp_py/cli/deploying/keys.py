"""`rcdeploy keys`: who may take part in a network, as keys and certificates."""

from __future__ import annotations

import argparse

from ..common import complain
from .planning import add_network, planned

NAME = "keys"
HELP = "make the keys and certificates of a network"

_EXAMPLES = """\
examples:
  rcdeploy keys net.ddsl       make what is missing or has expired

exit status: 0 fine, 1 the network is wrong or the keys cannot be written, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Make the keys and certificates of a network with `security lan`.", _EXAMPLES
    add_network(to)


def run(options: argparse.Namespace) -> int:
    plan = planned(options)
    if isinstance(plan, int):
        return plan
    return complain("rcdeploy keys: not in this version")  # SEAM for G: call deploy/keys.py here
