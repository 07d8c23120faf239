"""`rc run`: run a component."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ..errors import ComponentError
from ..runtime.notify import BETWEEN, is_launched
from . import outdated
from .common import FINE, complain, raise_if_signalled, signalled

NAME = "run"

_EXAMPLES = """\
examples:
  rc run .                                      until Ctrl-C
  rc run components/wander --name left          ... with another instance name
  rc run . --set component.period=0.02          ... with another period than its configuration says
  rc run . --help                               which options and parameters this component has
  rc run camera + detector --name left          two components in one process, each with its own options

exit status: 0 fine, 1 it failed, 2 usage, 130/143 stopped by a signal
"""

_COMPONENT_OPTIONS = (
    ("--config", "FILE", "configuration (default: etc/config.toml in DIR)"),
    ("--name", "NAME", "name of this instance"),
    ("--middleware", "NAME", "what carries its messages"),
    ("--set", "KEY=VALUE", "set one key of the configuration; may be repeated"),
    ("--keys", "FOLDER", "folder of its keys, for messages between hosts"),
    ("--grace", "SECONDS", "time to stop by itself, once told to (default: 5)"),
)
"""The options of a component that have a value, which would otherwise be mistaken for DIR."""


def split(arguments: Sequence[str]) -> list[list[str]]:
    """Split arguments at each `+`: the parts are for different components of one process."""
    parts: list[list[str]] = [[]]
    for argument in arguments:
        if argument == BETWEEN and arguments[0] == NAME:
            parts.append([])
        else:
            parts[-1].append(argument)
    return parts


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Run one component, in the foreground; rcdeploy runs networks of them.", _EXAMPLES
    to.add_argument("folder", type=Path, metavar="DIR", nargs="?", help="the component's folder, or its .cdsl")
    for name, value, what in _COMPONENT_OPTIONS:
        to.add_argument(name, metavar=value, action="append", type=partial(_again, name), dest="passed", help=what)
    to.add_argument("-h", "--help", action="store_true", help="show the component's own options")


def run(
    options: argparse.Namespace,
    rest: Sequence[str],
    usage: argparse.ArgumentParser,
    others: Sequence[Sequence[str]] = (),
) -> int:
    """`rest` holds the component's own options, `others` those of the components that share its process."""
    from ..runtime.load import load_worker
    from ..runtime.run import main as run_component

    if options.folder is None and options.help and not others:
        usage.print_help(sys.stdout)
        return FINE
    parts = [(options, rest), *(usage.parse_known_args(other) for other in others)]
    if None in [part.folder for part, _ in parts]:
        usage.error(f"give it the folder of a component{' behind each `+`' if others else ''}, as in: rc run .")
    for part, _ in parts:
        _warn_if_outdated(part.folder)
    try:
        workers = [load_worker(part.folder, afresh=bool(others), alone=not others) for part, _ in parts]
    except ComponentError as exc:
        return complain(exc)
    raise_if_signalled()  # on a signal that came while they were imported
    arguments = [[*(part.passed or []), *own, *(["--help"] if part.help else [])] for part, own in parts]
    if not others:
        return run_component(workers[0], arguments[0], missed=signalled)
    from ..runtime.together import main as run_together

    return run_together(list(zip(workers, arguments, strict=True)), signalled)


def run_plain(arguments: Sequence[str]) -> int | None:
    """Run a component if its arguments can be read without a parser; otherwise do nothing and return None."""
    from ..runtime.commandline import read_plain
    from ..runtime.load import load_worker
    from ..runtime.run import main as run_component

    folder, *rest = arguments or ["-"]
    options = None if folder.startswith("-") or not folder.strip() else read_plain(rest)
    if options is None:
        return None
    _warn_if_outdated(Path(folder))
    try:
        worker = load_worker(Path(folder), alone=True)
    except ComponentError as exc:
        return complain(exc)
    raise_if_signalled()
    return run_component(worker, options=options, missed=signalled)


def _warn_if_outdated(folder: Path) -> None:
    """Warn of old generated code, unless a launcher starts the component: rcdeploy checks it before."""
    if not is_launched():
        outdated.warn(folder)


def _again(option: str, value: str) -> str:
    """An option, as passed to the component."""
    return f"{option}={value}"
