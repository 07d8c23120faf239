"""`rc run`: run a component."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ..errors import ComponentError
from .common import FINE, complain

NAME = "run"
HELP = "run a component"

_EXAMPLES = """\
examples:
  rc run .                                      until Ctrl-C
  rc run components/wander --name left          ... under another name than its own
  rc run . --set component.period=0.02          ... with another period than its configuration says
  rc run . --help                               which options and parameters this component has

exit status: 0 fine, 1 it failed, 2 usage, 130/143 stopped by a signal
"""

_COMPONENT_OPTIONS = (
    ("--config", "FILE", "configuration (default: etc/config.toml in DIR)"),
    ("--name", "NAME", "name of this instance"),
    ("--middleware", "NAME", "what carries its messages"),
    ("--set", "KEY=VALUE", "set one key of the configuration; may be repeated"),
)
"""What a component takes that is followed by a value, which would be taken for DIR otherwise."""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Run one component, in the foreground; rcdeploy runs networks of them.", _EXAMPLES
    to.formatter_class = argparse.RawDescriptionHelpFormatter
    to.add_argument("folder", type=Path, metavar="DIR", nargs="?", help="the component's folder")
    for name, value, what in _COMPONENT_OPTIONS:
        to.add_argument(name, metavar=value, action="append", type=partial(_again, name), dest="passed", help=what)
    to.add_argument("-h", "--help", action="store_true", help="show the component's own options")


def run(options: argparse.Namespace, rest: Sequence[str], usage: argparse.ArgumentParser) -> int:
    """`rest` is what only the component itself understands."""
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
