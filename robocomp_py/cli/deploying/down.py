"""`rcdeploy down`: stop a network that runs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..common import FINE
from .connected import add_network, connected
from .up import seconds

if TYPE_CHECKING:
    from ...deploy.client import Connection

NAME = "down"
HELP = "stop a running network"

_EXAMPLES = """\
examples:
  rcdeploy down net.ddsl              stop everything in order, and wait until it is gone
  rcdeploy down net                   ... of a network by its name, in whichever terminal it was started
  rcdeploy down net.ddsl --grace 0.5  ... kill what has not ended after half a second
  rcdeploy down net.ddsl --now        ... at once

exit status: 0 it is gone, 1 it was not running or does not end, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Stop a running network and wait until all its processes have ended.", _EXAMPLES
    add_network(to)
    to.add_argument(
        "--grace", type=seconds, metavar="SECONDS", help="time for each process to end by itself before it is killed"
    )
    to.add_argument("--now", dest="grace", action="store_const", const=0.0, help="kill everything")


def run(options: argparse.Namespace) -> int:
    return connected(
        options.network, lambda connection: _down(connection, options.grace), lambda: _end_kept(options.network)
    )


def _down(connection: Connection, grace_s: float | None) -> int:
    from ...deploy.client import down

    down(connection, grace_s, _tell)
    print(f"{connection.network} is down")
    return FINE


def _end_kept(network: str) -> int | None:
    """End what hosts keep running (`lost keep`) after their controller was lost; None if there is nothing."""
    from ...deploy.hosts.fleet import end_kept, keeping

    found = keeping(Path(network)) if network.endswith(".ddsl") else None
    if not found:
        return None
    name, hosts = found
    ended = end_kept(name, hosts)
    print(f"{name} was not run from here; ended on {', '.join(hosts)}: {', '.join(ended) or 'nothing ran there'}")
    return FINE


def _tell(there: int, all_of_them: int) -> None:
    print(f"stopping: {there} of {all_of_them} processes still run", flush=True)
