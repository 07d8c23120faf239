"""`rcdeploy plan`: what would run, and how it differs from the running network."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ..common import FINE, complain
from ..network import add_clock, add_network
from .connected import show
from .guarding import add_keys, with_keys
from .planning import planned

if TYPE_CHECKING:
    from ...deploy.changes import Change
    from ...deploy.plan import Plan

NAME = "plan"
HELP = "show what would run, and start nothing"

_EXAMPLES = """\
examples:
  rcdeploy plan net.ddsl                      what would run where, in which order, over what
  rcdeploy plan net.ddsl --middleware zeromq  ... over that middleware
  rcdeploy plan net.ddsl --json               ... for machines

If the network is running, the plan also shows what a new start would change.
Exit status: 0 fine, 1 the network is wrong, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Check a network and show what would run. Nothing is started.", _EXAMPLES
    add_network(to)
    add_clock(to)
    add_keys(to)
    to.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    from ...deploy.streams import discard

    plan = planned(options, as_json=options.json)
    if isinstance(plan, int):
        return plan
    plan = with_keys(plan, options)
    try:
        _write(plan, options.json)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as exc:
        discard(sys.stdout)
        return complain(f"rcdeploy: the plan cannot be written: {exc.strerror}")
    return FINE


def _write(plan: Plan, as_json: bool) -> None:
    from ...deploy.overview import command_line, difference, overview

    news = _news(plan)
    if as_json:
        print(
            json.dumps(
                plan.to_json() | ({} if news is None else {"changes": [asdict(each) for each in news]}), indent=2
            )
        )
        return
    for line in overview(plan):
        show(line)
    print()
    for process in plan.processes:
        show([(command_line(process, Path.cwd()), "dim")])
    if news is not None:
        print()
        differing = difference(news)
        compared = "differs from the running network:" if news else "matches the running network"
        show([(f"{plan.name} {compared}", "bold")])
        for line in differing:
            show(line)


def _news(plan: Plan) -> list[Change] | None:
    """The differences from the running network; None if it is not running."""
    from ...deploy.changes import changes
    from ...deploy.client import Connection, NotRunning, running_plan
    from ...deploy.contracts import running_contracts
    from ...errors import DeploymentError

    try:
        running = running_plan(plan.name)
        if running is None:
            return None
        with Connection(plan.name) as connection:
            told = running_contracts(connection.status().processes)
    except NotRunning:
        return None
    except DeploymentError as exc:
        print(f"rcdeploy: {exc}; cannot tell what would change", file=sys.stderr)
        return None
    return changes(running, json.loads(json.dumps(plan.to_json())), told)
