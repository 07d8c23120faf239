"""What the commands share."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import Protocol, TextIO

from .. import __version__
from ..dsl.diagnostics import Diagnostic, did_you_mean, ordered

FINE, WRONG, USAGE, INTERRUPTED = 0, 1, 2, 130


class Main(Protocol):
    """A command: its arguments (by default those of the process) to its exit code."""

    def __call__(self, arguments: Sequence[str] | None = None) -> int: ...


def command(main: Callable[[Sequence[str] | None], int]) -> Main:
    """A command that ends quietly when it is interrupted, or when nobody reads on what it prints."""

    @wraps(main)
    def run(arguments: Sequence[str] | None = None) -> int:
        try:
            code = main(arguments)
            sys.stdout.flush()
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains when it ends
            return WRONG
        except KeyboardInterrupt:
            return INTERRUPTED
        return code

    return run


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


def no_such(what: str, name: str, known: Iterable[str]) -> str:
    """`no middleware `zermq`; did you mean `zeromq`? installed: inproc, zeromq`."""
    names = sorted(known)
    proposal = did_you_mean(name, names)
    return f"no {what} `{name}`; {proposal + ' ' if proposal else ''}installed: {', '.join(names) or 'none'}"
