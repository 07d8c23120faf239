"""`rc lint`: check files of any of the languages."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .common import FINE, WRONG, add_include, show

if TYPE_CHECKING:
    from ..dsl.workspace import Workspace  # running a component must not import the languages

NAME = "lint"
HELP = "check .idsl, .cdsl, .pdsl and .ddsl files"


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.add_argument("files", nargs="+", type=Path, metavar="FILE")
    to.add_argument("--json", action="store_true", help="one diagnostic a line, as JSON on stdout")
    add_include(to)


def run(options: argparse.Namespace) -> int:
    from ..dsl.workspace import Workspace

    workspace = Workspace(options.include)
    for path in options.files:
        if path.suffix.lower() == ".ddsl":
            _check_network(path, workspace)
        else:
            workspace.check(path)
    show(workspace.report.diagnostics, as_json=options.json)
    return WRONG if workspace.report.errors else FINE


def _check_network(path: Path, workspace: Workspace) -> None:
    """Check a network as the deployer would, except for what only a start needs."""
    from ..deploy.plan import make_plan

    make_plan(path, workspace)
    report = workspace.report
    report.diagnostics = [each for each in report.diagnostics if each.code != "not-generated"]
