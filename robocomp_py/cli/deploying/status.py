"""`rcdeploy status`: the state of a running network."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import asdict
from typing import TYPE_CHECKING

from ..common import FINE, UNREACHABLE, USAGE, WRONG, complain, raise_if_signalled
from ..completing import What, completed
from .connected import NETWORK, connected, show

if TYPE_CHECKING:
    from ...deploy.client import Connection
    from ...deploy.snapshot import Snapshot

NAME = "status"
HELP = "show the state of a running network"

_EXAMPLES = """\
examples:
  rcdeploy status net.ddsl          a table of its processes
  rcdeploy status net.ddsl --watch  ... again every second, until Ctrl-C or the end of the network
  rcdeploy status net.ddsl --ports  ... and the peers and middlewares of each component
  rcdeploy status net.ddsl --json   for machines, on one line
  rcdeploy status                   your networks on this machine, one line each

exit status: 0 everything is ready, or has done its work; 1 something is not, or two components have different contracts
of an interface, or the network does not run; 2 usage; 3 a host is out of reach
"""

_EVERY_S = 1.0


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Show the state of a running network.", _EXAMPLES
    about = "the network, by its file or by its name"
    completed(to.add_argument("network", nargs="?", metavar=NETWORK, help=about), What.NETWORK)
    to.add_argument("--watch", action="store_true", help="again every second")
    to.add_argument("--ports", action="store_true", help="also the ports of the components, with their peers")
    to.add_argument("--json", action="store_true", help="for machines, on one line")


def run(options: argparse.Namespace) -> int:
    from ...deploy.client import networks
    from ...errors import ConfigurationError

    if options.network:
        return connected(options.network, lambda connection: _show(connection, options))
    for option, is_given in (("--watch", options.watch), ("--ports", options.ports)):
        if is_given:
            print(f"rcdeploy status: {option} needs a network", file=sys.stderr)
            return USAGE
    try:
        found = networks()
    except ConfigurationError as exc:
        return complain(f"rcdeploy: {exc}")
    if not found and not options.json:
        print("none of your networks is running on this machine")
    return max((connected(each, lambda connection: _tell(connection, options.json)) for each in found), default=FINE)


def _show(connection: Connection, options: argparse.Namespace) -> int:
    from ...deploy.client import running_plan

    while True:
        snapshot = connection.status()
        plan = running_plan(snapshot.network) or {}
        _print(snapshot, plan.get("ways", []) if options.ports else None, options)
        is_broken = _tell_contracts(snapshot, options)
        sys.stdout.flush()
        if not options.watch:
            return _code(snapshot) or (WRONG if is_broken else FINE)
        raise_if_signalled()
        time.sleep(_EVERY_S)


def _tell_contracts(snapshot: Snapshot, options: argparse.Namespace) -> bool:
    """Say which instances run an older contract. Returns whether two linked ones have different contracts."""
    from ...deploy import contracts
    from ...deploy.client import running_plan

    plan = running_plan(snapshot.network) or {}
    running = contracts.running_contracts(snapshot.processes)
    broken = contracts.broken_links(plan.get("links", ()), running)
    if options.json:
        return bool(broken)
    outdated = contracts.outdated(running, contracts.generated_contracts(plan))
    for line in contracts.sentences(options.network, broken, outdated):
        show([(line, "bold red" if broken else "yellow")])
    return bool(broken)


def _tell(connection: Connection, as_json: bool) -> int:
    from ...deploy.table import summary

    snapshot = connection.status()
    if as_json:
        print(json.dumps(asdict(snapshot)))
    else:
        show(summary(snapshot))
    return _code(snapshot)


def _print(snapshot: Snapshot, ways: list[dict[str, str]] | None, options: argparse.Namespace) -> None:
    from ...deploy.table import ports, summary, table

    again = options.watch
    if options.json:
        print(json.dumps(asdict(snapshot) | ({} if ways is None else {"ways": ways})))
        return
    size = os.get_terminal_size(sys.stdout.fileno()) if sys.stdout.isatty() else None
    if size and again:
        print("\033[2J\033[H", end="")  # clear the terminal and begin at its first line
    show(summary(snapshot))
    for line in table(
        snapshot, width=size.columns if size else None, height=size.lines - 2 if size and again else None
    ):
        show(line)
    if ways is not None:
        print()
        for line in ports(ways) or [[("no instance of this network uses another one", "")]]:
            show(line)


def _code(snapshot: Snapshot) -> int:
    from ...deploy.policy import State

    if any(not host.reachable for host in snapshot.hosts):
        return UNREACHABLE
    fine = all(each.state in (State.READY, State.ENDED) for each in snapshot.processes)
    return FINE if fine and not snapshot.stopping else WRONG
