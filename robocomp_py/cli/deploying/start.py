"""`rcdeploy start`: start components of a running network that were stopped, or have ended."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from ..common import USAGE, complain
from ..completing import What, completed
from .connected import add_network, connected
from .restart import add_within, contract_conflict, tell_started, tell_waiting

if TYPE_CHECKING:
    from ...deploy.client import Connection

NAME = "start"
HELP = "start components of a running network that do not run"

_EXAMPLES = """\
examples:
  rcdeploy start net.ddsl laser  start it, and wait until it is ready
  rcdeploy start net.ddsl left   ... all of a system that do not run

This starts components that `rcdeploy stop` stopped, and those that have ended or failed. Those that run are left alone,
unless the `escalation` of a system restarts them along. To start a network: rcdeploy NET.ddsl
Exit status: 0 all are ready, or have done their work; 1 one is not; 2 usage; 3 its host is out of reach
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.usage = "rcdeploy start [-h] [--within SECONDS] NET.ddsl INSTANCE [INSTANCE ...]"
    to.description, to.epilog = "Start components of a running network that do not run.", _EXAMPLES
    add_network(to)
    names = to.add_argument("names", nargs="*", metavar="INSTANCE", help="an instance, a process or a system")
    completed(names, What.INSTANCE)
    add_within(to)


def run(options: argparse.Namespace) -> int:
    if not options.names:
        print(
            f"rcdeploy start: which INSTANCE of `{options.network}`? To start the network: rcdeploy {options.network}",
            file=sys.stderr,
        )
        return USAGE
    return connected(options.network, lambda connection: _start(connection, options))


def _start(connection: Connection, options: argparse.Namespace) -> int:
    from ...deploy.client import restart, to_start
    from ...deploy.naming import meant

    idle = to_start(connection, options.names)
    if idle and (why := contract_conflict(connection, options.network, idle)):
        return complain(f"rcdeploy: nothing was started: {why}")
    for each in meant(options.names, connection.status().processes):
        if each.name not in idle:
            print(f"{each.name} runs already")
    done = restart(connection, idle, options.within, tell_waiting) if idle else []
    return tell_started(done, options.network, "ready")
