"""`rcdeploy restart`: restart components of a running network."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..common import FINE, complain
from ..completing import What, completed
from .connected import add_network, connected
from .up import seconds

if TYPE_CHECKING:
    from ...deploy.client import Connection
    from ...deploy.snapshot import ProcessStatus

NAME = "restart"
HELP = "restart components of a running network"

_EXAMPLES = """\
examples:
  rcdeploy restart net.ddsl laser         stop it, start it and wait until it is ready
  rcdeploy restart net.ddsl laser camera  ... two of them
  rcdeploy restart net.ddsl left          ... all of a system

Components that share a process restart together. If an interface has changed since the network started, restart all
components that use it in one command. Exit status: 0 all are ready again, or have done their work; 1 one is not;
2 usage; 3 its host is out of reach
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Restart components of a running network.", _EXAMPLES
    add_network(to)
    names = to.add_argument("names", nargs="+", metavar="INSTANCE", help="an instance, a process or a system")
    completed(names, What.INSTANCE)
    add_within(to)


def add_within(to: argparse.ArgumentParser) -> None:
    to.add_argument(
        "--within",
        type=seconds,
        default=60.0,
        metavar="SECONDS",
        help="time to wait until it is ready (default: 60)",
    )


def run(options: argparse.Namespace) -> int:
    return connected(options.network, lambda connection: _restart(connection, options))


def _restart(connection: Connection, options: argparse.Namespace) -> int:
    from ...deploy.client import restart

    if why := contract_conflict(connection, options.network, options.names):
        return complain(f"rcdeploy: nothing was restarted: {why}")
    return tell_started(
        restart(connection, options.names, options.within, tell_waiting), options.network, "ready again"
    )


def tell_started(done: Sequence[ProcessStatus], network: str, ready: str) -> int:
    """Print how processes are after they were started. Returns the exit code."""
    from ...deploy.policy import State

    failed = [each for each in done if each.state is State.FAILED]
    for each in done:
        if each not in failed:
            print(f"{each.name} is {ready}" if each.state is State.READY else f"{each.name} has ended")
    for each in failed:
        complain(f"rcdeploy: {each.name} {each.how or 'has failed'}; see: rcdeploy logs {network} {each.name}")
    return 1 if failed else FINE


def contract_conflict(connection: Connection, network: str, names: Sequence[str]) -> str:
    """Why started instances could not communicate with those that keep running; "" if they can."""
    from ...deploy import contracts
    from ...deploy.client import running_plan
    from ...deploy.naming import meant

    plan, processes = running_plan(connection.network) or {}, connection.status().processes
    running, current = contracts.running_contracts(processes), contracts.generated_contracts(plan)
    asked = [name for each in meant(names, processes) for name in each.instances]
    found = contracts.effect_of_restart(plan.get("links", ()), running, current, asked)
    if not found.broken:
        return ""
    links = "\n".join(f"  {each.client} uses {each.interface} of {each.provider}" for each in found.broken)
    says = f"these would then have different contracts:\n{links}\n"
    if not found.together:
        return f"{says}Generate them from the same interfaces: rcgen NET.ddsl"
    older = contracts.outdated(running, current)
    old = "; ".join(f"{name} runs an older contract of {', '.join(older[name])}" for name in found.together)
    together = shlex.join((network, *names, *found.together))
    return f"{says}{old}\nRestart them together: rcdeploy restart {together}"


def tell_waiting(missing: list[str]) -> None:
    print(f"waiting for {', '.join(missing)}", flush=True)
