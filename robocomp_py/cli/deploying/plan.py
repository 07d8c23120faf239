"""`rcdeploy plan`: what would run."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from typing import TYPE_CHECKING

from ..common import FINE, complain
from .planning import add_network, planned

if TYPE_CHECKING:
    from ...deploy.plan import Plan

NAME = "plan"
HELP = "show what would run, and start nothing"

_EXAMPLES = """\
examples:
  rcdeploy plan net.ddsl                      what would run, in which order, over what
  rcdeploy plan net.ddsl --middleware zeromq  ... over that middleware
  rcdeploy plan net.ddsl --json               ... for machines

exit status: 0 fine, 1 the network is wrong, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Check a network and show what would run. Nothing is started.", _EXAMPLES
    add_network(to)
    to.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    plan = planned(options, as_json=options.json)
    return plan if isinstance(plan, int) else _print(plan, options.json)


def _print(plan: Plan, as_json: bool) -> int:
    from ...deploy.terminal import discard

    try:
        _write(plan, as_json)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as exc:
        discard(sys.stdout)
        return complain(f"rcdeploy: the plan cannot be written: {exc.strerror}")
    return FINE


def _write(plan: Plan, as_json: bool) -> None:
    if as_json:
        print(json.dumps(plan.to_json(), indent=2))
        return
    from rich.console import Console
    from rich.text import Text

    from ...deploy.terminal import table_of

    console = Console()
    console.print(table_of(plan))
    for process in plan.processes:
        console.print(Text(f"{process.name}: {shlex.join(process.command)}", style="dim"), soft_wrap=True)
