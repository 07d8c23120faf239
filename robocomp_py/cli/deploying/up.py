"""`rcdeploy up`: start a network, watch it, stop it."""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..common import FINE, USAGE, complain, signalled
from ..completing import What, completed
from ..network import add_clock, add_network
from .guarding import add_guards, guarded
from .planning import planned

if TYPE_CHECKING:
    from ...deploy.plan import Plan
    from .detached import Parent

NAME = "up"
HELP = "start a network; what `rcdeploy NET.ddsl` does"

_EXAMPLES = """\
examples:
  rcdeploy up net.ddsl                              start everything; Ctrl-C stops it, twice kills it
  rcdeploy up net.ddsl --detach                     ... and return when it is ready; it goes on until rcdeploy down
  rcdeploy up net.ddsl --for 30                     ... for half a minute
  rcdeploy up net.ddsl --until mission              ... until that instance ends
  rcdeploy up net.ddsl --middleware zeromq          ... over that middleware and no other
  rcdeploy up net.ddsl --clock world --speed max    ... all follow the clock of world, as fast as they can
  rcdeploy up net.ddsl --diary wander               write wander.mcap, by which rc rerun runs its code again
  rcdeploy up net.ddsl --set world.params.step=0.1  set a key of an instance's configuration (*: of all)

exit status: 0 fine, 1 wrong input or something failed, 2 usage, 3 a host cannot be reached,
130/143 stopped by a signal; with --detach, 0 if the network goes on, 1 also if it was stopped before it was ready
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Check a network, start it in order, watch it, and stop it.", _EXAMPLES
    add_network(to)
    add_clock(to)
    add_options(to)


def add_options(to: argparse.ArgumentParser) -> None:
    """All options except those that change the network."""
    to.add_argument(
        "--for", dest="duration", type=seconds, metavar="SECONDS", help="stop this long after all components are ready"
    )
    about = "stop the network when this instance ends"
    completed(to.add_argument("--until", metavar="INSTANCE", help=about), What.DECLARED)
    to.add_argument("--log-dir", type=Path, metavar="DIR", help="folder for the logs of the components")
    to.add_argument(
        "--record-logs", choices=("text", "json"), default="text", help="format of the logs (default: text)"
    )
    to.add_argument(
        "--detach", action="store_true", help="return when all components are ready, and leave the network running"
    )
    to.add_argument(
        "--diary",
        action="append",
        default=[],
        metavar="INSTANCE",
        help="write INSTANCE.mcap here: all that enters its code, by which `rc rerun` runs it again; may be repeated",
    )
    add_guards(to)


def run(options: argparse.Namespace) -> int:
    from ... import installed
    from .detached import detached

    if options.diary:  # the order of sets of texts is the same when the code is run again
        os.environ.setdefault("PYTHONHASHSEED", "0")
    with installed.asked_once():
        return detached(lambda parent: _run(options, parent)) if options.detach else _run(options)


def _run(options: argparse.Namespace, parent: Parent | None = None) -> int:
    from ...spelling import unknown

    plan = planned(options)
    if isinstance(plan, int):
        return plan
    ending = sorted({name for process in plan.processes for name in (process.name, *process.instances)})
    if options.until and options.until not in ending:
        print(f"rcdeploy: --until {options.until}: {unknown('instance', options.until, ending)}", file=sys.stderr)
        return USAGE
    if not plan.processes:
        return complain(f"rcdeploy: {plan.name} has no components to leave running") if parent else FINE
    plan = guarded(plan, options)
    return plan if isinstance(plan, int) else _up(plan, options, parent)


def _up(plan: Plan, options: argparse.Namespace, parent: Parent | None) -> int:
    from ...deploy import neighbours
    from ...deploy.logs import Form, Logs
    from ...deploy.place import Place
    from ...deploy.run import Options
    from ...deploy.terminal import run_on_terminal
    from ...errors import ConfigurationError, DeploymentError, TransportError

    network = shlex.quote(str(options.network))

    def leave(complaints: Path) -> None:
        assert parent
        with contextlib.suppress(OSError):
            print(f"{plan.name} is running (process {os.getpid()}); status: rcdeploy status {network}; "
                  f"to stop it: rcdeploy down {network}", flush=True)  # fmt: skip
        parent.leave(complaints)

    try:
        runner = Place(plan.name).runner()
        if runner and runner.is_there:  # otherwise the lock is free in a moment: `take` waits for that
            return complain(
                f"rcdeploy: {plan.name} is already running (process {runner.pid}); status: rcdeploy status {network}; "
                f"changes: rcdeploy plan {network}; to stop it: rcdeploy down {network}"
            )
        for each in neighbours.warnings(plan):
            print(f"rcdeploy: warning: {each}", file=sys.stderr, flush=True)
        folder = options.log_dir or Place(plan.name).logs
        logs = Logs(folder, number=len(plan.processes), form=Form(options.record_logs))
        with contextlib.closing(logs):
            wanted = Options(options.duration, options.until, signalled=signalled)
            code = run_on_terminal(plan, wanted, leave if parent else None, logs)
        if parent and parent.waits and code == FINE:  # the waiting command expects a running network
            return complain(f"rcdeploy: {plan.name} ended before everything was ready")
        return code
    except (TransportError, ConfigurationError, DeploymentError) as exc:
        return complain(f"rcdeploy: {exc}")


def seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"`{text}` is not a number of seconds; write it as 30 or 0.5")
    return value
