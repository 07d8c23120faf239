"""`rc`: everything about components that is neither generating nor deploying."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import ComponentError
from .common import FINE, WRONG, add_include, add_version, command, complain, parser, show

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

_COMPONENT_OPTIONS = (
    ("--config", "FILE", "configuration (default: etc/config.toml in DIR)"),
    ("--name", "NAME", "name of this instance"),
    ("--middleware", "NAME", "what carries its messages"),
    ("--set", "KEY=VALUE", "set one key of the configuration; may be repeated"),
)
"""What a component takes that is followed by a value, which would be taken for DIR otherwise."""


@command
def main(arguments: Sequence[str] | None = None) -> int:
    made = parser("rc", "Check and run components.", _EXAMPLES)
    commands = made.add_subparsers(dest="command", metavar="COMMAND", required=True)
    lint = commands.add_parser("lint", help="check .idsl, .cdsl, .pdsl and .ddsl files")
    lint.add_argument("files", nargs="+", type=Path, metavar="FILE")
    lint.add_argument("--json", action="store_true", help="one diagnostic a line, as JSON on stdout")
    add_include(lint)
    add_version(lint, "rc lint")
    run = commands.add_parser("run", help="run a component", add_help=False)
    run.add_argument("folder", type=Path, metavar="DIR", nargs="?", help="the component's folder")
    for name, value, what in _COMPONENT_OPTIONS:
        run.add_argument(name, metavar=value, action="append", type=partial(_again, name), dest="passed", help=what)
    run.add_argument("-h", "--help", action="store_true", help="show the component's own options")
    add_version(run, "rc run")
    options, rest = made.parse_known_args(arguments)
    if rest and options.command != "run":
        lint.error(f"unrecognized arguments: {' '.join(rest)}")
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

    if options.folder is None and options.help:
        usage.print_help(sys.stdout)
        return FINE
    if options.folder is None:
        usage.error("give it the folder of a component, as in: rc run .")
    try:
        worker = load_worker(options.folder)
    except ComponentError as exc:
        return complain(exc)
    return run_component(worker, [*(options.passed or []), *rest, *(["--help"] if options.help else [])])


def _again(option: str, value: str) -> str:
    """An option of the component as it is given to it."""
    return f"{option}={value}"


if __name__ == "__main__":  # how a deployer starts components
    raise SystemExit(main())
