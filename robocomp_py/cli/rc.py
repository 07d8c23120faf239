"""`rc`: everything about components that is neither generating nor deploying."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import ComponentError
from .common import FINE, USAGE, WRONG, add_include, command, complain, parser, show

if TYPE_CHECKING:
    from ..dsl.workspace import Workspace  # running a component must not import the languages

_EXAMPLES = """\
examples:
  rc lint interfaces/*.idsl           check files of any of the languages
  rc lint --json net.ddsl             ... one diagnostic a line, for machines
  rc run components/wander            run a component until Ctrl-C
  rc run . --set component.period=0.02 --name left

exit status: 0 fine, 1 wrong input or a component failed, 2 usage, 130/143 by a signal
"""


@command
def main(arguments: Sequence[str] | None = None) -> int:
    made = parser("rc", "Check and run components.", _EXAMPLES)
    commands = made.add_subparsers(dest="command", metavar="COMMAND", required=True)
    lint = commands.add_parser("lint", help="check .idsl, .cdsl, .pdsl and .ddsl files")
    lint.add_argument("files", nargs="+", type=Path, metavar="FILE")
    lint.add_argument("--json", action="store_true", help="one diagnostic a line, as JSON on stdout")
    add_include(lint)
    run = commands.add_parser("run", help="run a component", add_help=False)
    run.add_argument("folder", type=Path, metavar="DIR", nargs="?", help="the component's folder")
    run.add_argument("-h", "--help", action="store_true", help="show the component's own options")
    options, rest = made.parse_known_args(arguments)
    if rest and options.command != "run":
        made.error(f"unrecognized arguments: {' '.join(rest)}")
    return _lint(options) if options.command == "lint" else _run(options, rest, run)


def _lint(options: argparse.Namespace) -> int:
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


def _run(options: argparse.Namespace, rest: list[str], usage: argparse.ArgumentParser) -> int:
    from ..runtime.load import load_worker
    from ..runtime.run import main as run_component

    if options.folder is None:
        usage.print_help(sys.stdout if options.help else sys.stderr)
        return FINE if options.help else USAGE
    try:
        worker = load_worker(options.folder)
    except ComponentError as exc:
        return complain(exc)
    return run_component(worker, [*rest, *(["--help"] if options.help else [])])


if __name__ == "__main__":  # how a deployer starts components
    raise SystemExit(main())
