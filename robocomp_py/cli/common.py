"""What the commands share."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TextIO

from .. import __version__
from ..dsl.diagnostics import Diagnostic, ordered

FINE, WRONG, USAGE = 0, 1, 2


def parser(name: str, description: str, epilog: str = "") -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog=name, description=description, epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument("--version", action="version", version=f"{name} (robocomp_py) {__version__}")
    return made


def add_include(to: argparse.ArgumentParser) -> None:
    to.add_argument(
        "-I",
        dest="include",
        action="append",
        default=[],
        type=Path,
        metavar="DIR",
        help="folder in which imports are looked for, too; may be repeated",
    )


def show(diagnostics: Iterable[Diagnostic], *, as_json: bool = False, to: TextIO | None = None) -> None:
    """Print diagnostics in order: for people to stderr, as JSON lines to stdout."""
    for each in ordered(diagnostics):
        if as_json:
            print(json.dumps(each.to_json()), file=to or sys.stdout)
        else:
            print(each.render(), file=to or sys.stderr)


def complain(message: object) -> int:
    """Say what is wrong; the exit code for it."""
    print(message, file=sys.stderr)
    return WRONG
