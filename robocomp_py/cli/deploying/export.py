"""`rcdeploy export`: write a network as files for systemd, compose or Kubernetes."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

from ..common import FINE, complain
from ..network import add_clock, add_network
from .guarding import add_guards, guarded
from .planning import planned

NAME = "export"
HELP = "write a network for systemd, compose or Kubernetes"

_EXAMPLES = """\
examples:
  rcdeploy export systemd net.ddsl -o units        a unit for each process
  rcdeploy export compose net.ddsl -o composed     a compose file
  rcdeploy export kubernetes net.ddsl -o cluster   manifests

exit status: 0 fine, 1 the network is wrong or cannot be exported, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Write a network as files that another engine runs.", _EXAMPLES
    to.add_argument("engine", choices=("systemd", "compose", "kubernetes"), metavar="ENGINE",
                    help="systemd, compose or kubernetes")  # fmt: skip
    add_network(to)
    add_clock(to)
    add_guards(to)
    to.add_argument("-o", dest="output", type=Path, required=True, metavar="DIR", help="the folder to write into")


def run(options: argparse.Namespace) -> int:
    plan = planned(options)
    if not isinstance(plan, int):
        plan = guarded(plan, options)
    if isinstance(plan, int):  # the exit code of an error, which has been printed
        return plan
    from ...deploy.exporters import EXPORTERS, write_export
    from ...errors import DeploymentError

    try:
        export = EXPORTERS[options.engine](plan, options.network.name)
        write_export(export, options.output)
    except DeploymentError as exc:
        return complain(f"rcdeploy export: {exc}")
    for note in export.notes:
        print(f"note: {note}", file=sys.stderr)
    print(f"{options.output}: {', '.join(map(str, export.files))}")
    print("next:", *(f"cd {shlex.quote(str(options.output))}", *export.steps), sep="\n  ")
    return FINE
