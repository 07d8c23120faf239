"""`rcdeploy stop`: stop components of a running network."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from ..common import FINE, USAGE, complain
from ..completing import What, completed
from .connected import add_network, connected

if TYPE_CHECKING:
    from ...deploy.client import Connection

NAME = "stop"
HELP = "stop components of a running network"

_EXAMPLES = """\
examples:
  rcdeploy stop net.ddsl laser         stop it, and wait until it has ended
  rcdeploy stop net.ddsl laser camera  ... two of them
  rcdeploy stop net.ddsl left          ... all of a system
  rcdeploy start net.ddsl laser        start it again

A stopped component stays so, whatever its `restart` says, until `rcdeploy start` or `restart`. The others run on.
Components that share a process stop together. At least one must go on: `rcdeploy down` stops the whole network.
Exit status: 0 all have ended; 1 one had to be killed, or nothing was stopped; 2 usage; 3 its host is out of reach
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.usage = "rcdeploy stop [-h] NET.ddsl INSTANCE [INSTANCE ...]"
    to.description, to.epilog = "Stop components of a running network.", _EXAMPLES
    add_network(to)
    names = to.add_argument("names", nargs="*", metavar="INSTANCE", help="an instance, a process or a system")
    completed(names, What.INSTANCE)


def run(options: argparse.Namespace) -> int:
    if not options.names:
        whole = f"To stop the whole network: rcdeploy down {options.network}"
        print(f"rcdeploy stop: which INSTANCE of `{options.network}`? {whole}", file=sys.stderr)
        return USAGE
    return connected(options.network, lambda connection: _stop(connection, options))


def _stop(connection: Connection, options: argparse.Namespace) -> int:
    from ...deploy.client import stop
    from ...deploy.policy import State

    done, ended = stop(connection, options.names, lambda names: print(f"stopping {', '.join(names)}", flush=True))
    code = FINE
    for each in done:
        if each.name in ended:
            print(f"{each.name} had ended before")
        elif each.state is State.FAILED:
            code = complain(
                f"rcdeploy: {each.name} {each.how or 'has failed'}; see: rcdeploy logs {options.network} {each.name}"
            )
        else:
            print(f"{each.name} is stopped; to start it again: rcdeploy start {options.network} {each.name}")
    return code
