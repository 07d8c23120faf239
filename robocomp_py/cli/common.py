"""What the commands share."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from types import FrameType
from typing import NoReturn, Protocol, TextIO

from .. import __version__
from ..dsl.diagnostics import Diagnostic, ordered

FINE, WRONG, USAGE, INTERRUPTED = 0, 1, 2, 130


class Main(Protocol):
    """A command: its arguments (by default those of the process) to its exit code."""

    def __call__(self, arguments: Sequence[str] | None = None) -> int: ...


def command(main: Callable[[Sequence[str] | None], int]) -> Main:
    """A command that ends quietly, and cleans up, when it is interrupted, or when nobody reads on what it prints."""

    @wraps(main)
    def run(arguments: Sequence[str] | None = None) -> int:
        try:
            with _unwinding():
                os.getcwd()
                code = main(arguments)
                sys.stdout.flush()
        except FileNotFoundError:
            if _is_somewhere():
                raise
            return complain("the working directory is not there any more; change to one that is")
        except _Ended as ended:
            return int(ended.code)
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains when it ends
            return WRONG
        except KeyboardInterrupt:
            return INTERRUPTED
        return code

    return run


class _Ended(SystemExit):
    """A signal came. A SystemExit, which asyncio passes on, too."""

    code: int


@contextmanager
def _unwinding() -> Iterator[None]:
    """While entered, SIGTERM and SIGHUP end what runs as an exception does, so that it can clean up.

    Who wants to ignore them (`nohup`), or does something about them already, is not disturbed. What cleans up is
    not ended by another one.
    """
    numbers = [each for each in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(each) is signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        numbers = []  # only there signals can be taken care of

    def end(number: int, frame: FrameType | None) -> NoReturn:
        for each in numbers:
            signal.signal(each, signal.SIG_IGN)
        raise _Ended(128 + number)

    for each in numbers:
        signal.signal(each, end)
    try:
        yield
    finally:
        for each in numbers:
            signal.signal(each, signal.SIG_DFL)


def _is_somewhere() -> bool:
    """Whether the working directory exists."""
    try:
        return bool(os.getcwd())
    except FileNotFoundError:
        return False


def parser(name: str, description: str, epilog: str = "") -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog=name, description=description, epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_version(made, name)
    return made


def add_version(to: argparse.ArgumentParser, name: str) -> None:
    to.add_argument("--version", action="version", version=f"{name} (robocomp_py) {__version__}")


def add_include(to: argparse.ArgumentParser) -> None:
    def folder(text: str) -> Path:
        if not os.path.isdir(text):
            print(f"{to.prog}: warning: -I {text}: there is no such folder", file=sys.stderr)
        return Path(text)

    to.add_argument(
        "-I",
        dest="include",
        action="append",
        default=[],
        type=folder,
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
