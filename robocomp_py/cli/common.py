"""Shared by the commands."""

from __future__ import annotations

import argparse
import errno
import io
import json
import os
import re
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, NoReturn, Protocol, TextIO

from ..arguments import Parser
from ..version import __version__

if TYPE_CHECKING:
    from ..dsl.diagnostics import Diagnostic

FINE, WRONG, USAGE, UNREACHABLE, INTERRUPTED = 0, 1, 2, 3, 130


class Main(Protocol):
    """A command: a function from arguments (by default those of the process) to the exit code."""

    def __call__(self, arguments: Sequence[str] | None = None) -> int: ...


def command(main: Callable[[Sequence[str] | None], int]) -> Main:
    """Make a command end quietly, with cleanup, when it is interrupted or its output is no longer read."""

    @wraps(main)
    def run(arguments: Sequence[str] | None = None) -> int:
        try:
            with _unwinding():
                _prepare_output()
                os.getcwd()
                code = main(arguments)
                sys.stdout.flush()
        except _Ended as ended:
            return int(ended.code)
        except KeyboardInterrupt:
            return INTERRUPTED
        except Exception as exc:
            explained = _explained(exc)
            if isinstance(exc.__cause__, KeyboardInterrupt | _Ended):  # Python wraps it, for example in a __set_name__
                return 128 + (signalled() or signal.SIGINT)
            if explained is None:
                raise
            return 128 + signalled() if signalled() else explained
        finally:
            # Python remembers whether a KeyboardInterrupt left the last `exec`, such as that of a dataclass, and would
            # then end by that signal, although the exception was handled.
            exec("")
        return code

    return run


def _explained(exc: Exception) -> int | None:
    """Report an error that is not the command's fault and return its exit code; None for any other error."""
    match exc:
        case FileNotFoundError() if not _is_somewhere():
            return complain("the working directory no longer exists; change to another one")
        case BrokenPipeError():
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains when it ends
            return WRONG
        case OSError(filename=None) if exc.errno in _FULL:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return complain(f"cannot write the output: {exc.strerror}")
    return None


def _prepare_output() -> None:
    """Keep commands working if the output is closed, or cannot encode a character, such as one in a file name."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - for as long as we live
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


_LONGEST = 1e6
"""Seconds of one sleep; the system takes no more than 24 days."""

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of printing. Commands handle errors of their own files, with more details."""


class _Ended(SystemExit):
    """A signal came. A SystemExit, which asyncio passes on, too."""

    code: int


_came: list[int] = []
"""The signals received by the running command."""


def signalled() -> int:
    """The signal that ends, or should have ended, the running command; 0 if none was received.

    The exception of a signal can be lost: Python ignores exceptions in destructors, and in some callbacks while it
    imports. So code checks this before long work.
    """
    return _came[0] if _came else 0


def raise_if_signalled() -> None:
    """Raise the exception of a received signal again, in case it was lost."""
    match signalled():
        case 0:
            pass
        case signal.SIGINT:
            raise KeyboardInterrupt
        case number:
            raise _Ended(128 + number)


def raise_if_unread() -> None:
    """Raise BrokenPipeError if the program that read the output, such as `head`, has ended.

    A command that goes on calls this again and again. Otherwise it would end only once it has something to print.
    """
    sleep_while_read(0.0)


def sleep_while_read(seconds: float) -> None:
    """Sleep. Raises BrokenPipeError as soon as the program that reads the output has ended."""
    try:
        output = sys.stdout.fileno()
    except OSError:  # it is no file but text in memory
        time.sleep(seconds)
        return
    watched = select.poll()
    watched.register(output, 0)  # errors are told in any case
    found = watched.poll(min(seconds, _LONGEST) * 1000)
    if any(state & (select.POLLERR | select.POLLHUP) for _, state in found):
        raise BrokenPipeError


@contextmanager
def _unwinding() -> Iterator[None]:
    """While entered, SIGTERM and SIGHUP raise an exception, as Ctrl-C does, so that the command can clean up.

    A process that ignores them (`nohup`) or handles them keeps doing so. A second signal does not
    interrupt the cleanup.
    """
    numbers = [each for each in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(each) is signal.SIG_DFL]
    interrupting = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if threading.current_thread() is not threading.main_thread():
        numbers, interrupting = [], False  # only the main thread can handle signals

    def end(number: int, frame: FrameType | None) -> NoReturn:
        _came.append(number)
        for each in numbers:
            signal.signal(each, signal.SIG_IGN)
        raise _Ended(128 + number)

    def interrupt(number: int, frame: FrameType | None) -> NoReturn:
        _came.append(number)
        raise KeyboardInterrupt

    _came.clear()
    for each in numbers:
        signal.signal(each, end)
    if interrupting:
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        for each in numbers:
            signal.signal(each, signal.SIG_DFL)
        if signal.getsignal(signal.SIGINT) is interrupt:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _is_somewhere() -> bool:
    """Whether the working directory still exists."""
    try:
        return bool(os.getcwd())
    except FileNotFoundError:
        return False


def parser(name: str, description: str, epilog: str = "") -> Parser:
    made = Parser(prog=name, description=description, epilog=epilog)
    add_version(made, name)
    return made


def add_version(to: argparse.ArgumentParser, name: str) -> None:
    to.add_argument("--version", action="version", version=f"{name} (robocomp_py) {__version__}")


def describe(part: argparse.ArgumentParser, about: str, whole: argparse.ArgumentParser) -> None:
    """Let the help of a part of a command, such as `rc bag cut`, tell what it does, those examples of the whole command
    that show it, and the exit status."""
    told = whole.epilog or ""
    examples = "\n".join(re.findall(rf"^  {part.prog}\b.*", told, re.MULTILINE))
    part.description = f"{about[:1].upper()}{about[1:]}."
    part.epilog = f"examples:\n{examples}\n\n{told[told.index('exit status') :]}"


def add_include(
    to: argparse.ArgumentParser, help: str = "additional folder to search for imports; may be repeated"
) -> None:
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
        help=help,
    )


def files_of(
    paths: Iterable[Path], *, linked: bool, also: Callable[[Path], bool] = lambda _: False
) -> tuple[list[Path], list[str]]:
    """The files that paths stand for, each once, and the problems with folders among them.

    A folder stands for all files below it that are in one of the languages, or for which `also` is true. Hidden files
    are skipped. With `linked`, linked files are included; linked folders are never entered.
    """
    found: dict[str, Path] = {}
    problems: list[str] = []
    for path in paths:
        wrong: list[str] = []
        inside = list(_below(path, linked, wrong, also)) if path.is_dir() else [path]
        if not inside and not wrong:
            wrong.append(f"{path}: no model files in this folder")
        problems += wrong
        for each in inside:
            found.setdefault(os.path.abspath(each) if linked else os.path.realpath(each), each)
    return list(found.values()), problems


def _below(folder: Path, linked: bool, wrong: list[str], also: Callable[[Path], bool]) -> Iterator[Path]:
    from ..dsl.workspace import ENDINGS

    def note(exc: OSError) -> None:
        wrong.append(f"{exc.filename}: {exc.strerror}")

    for here, folders, names in os.walk(folder, onerror=note):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for path in (Path(here, name) for name in sorted(names) if not name.startswith(".")):
            is_meant = path.suffix.lower() in ENDINGS or also(path)
            if is_meant and (linked if path.is_symlink() else path.is_file()):
                yield path


def show(diagnostics: Iterable[Diagnostic], *, as_json: bool = False, to: TextIO | None = None) -> None:
    """Print diagnostics in order: for people to stderr, as JSON lines to stdout."""
    from ..dsl.diagnostics import ordered

    for each in ordered(diagnostics):
        if as_json:
            print(json.dumps(each.to_json()), file=to or sys.stdout)
        else:
            print(each.render(), file=to or sys.stderr)


def complain(message: object) -> int:
    """Print an error; return its exit code."""
    print(message, file=sys.stderr)
    return WRONG


def counted(number: int, what: str) -> str:
    """`1 message`, `2 messages`."""
    return f"{number} {what}{'' if number == 1 else 's'}"


_UNBROKEN = 1000
"""Length of a line that only programs read, so it is never wrapped."""

_LONG = 24
"""Characters of a word that is broken only if it is longer."""


def print_table(head: Sequence[str], rows: Iterable[Sequence[str]], wrapped: Sequence[str] = ()) -> None:
    """Print columns. On a terminal that is too narrow, those in `wrapped` get several lines.

    If they are then still too wide, the terminal breaks the lines: a column that is left out, or words in pieces, would
    be worse.
    """
    cells = [tuple(head), *map(tuple, rows)]
    lines = _columns(cells) if all(each.isascii() and each.isprintable() for row in cells for each in row) else []
    widest = max(map(len, lines), default=_UNBROKEN)
    import shutil

    if widest < (shutil.get_terminal_size().columns if sys.stdout.isatty() else _UNBROKEN):
        print("\n".join(lines))
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(highlight=False)
    table = Table(box=None, pad_edge=False, header_style="")
    most = console.width if console.is_terminal else _UNBROKEN
    for column, width in zip(head, _widths(cells, wrapped, most), strict=True):
        table.add_column(column, width=width, overflow="fold")  # a name that is cut is of no use
    for row in cells[1:]:
        table.add_row(*map(Text, row))
    console.width = max(console.width, _UNBROKEN)
    with console.capture() as captured:
        console.print(table)
    print("\n".join(line.rstrip() for line in captured.get().splitlines()))


def _widths(rows: Sequence[Sequence[str]], wrapped: Sequence[str], most: int) -> list[int]:
    """If the columns are wider than `most` together, those in `wrapped` get narrower, but no narrower than a word."""
    from rich.cells import cell_len

    widths = [max(map(cell_len, column)) for column in zip(*rows, strict=True)]
    least = [
        max(cell_len(head), min(_LONG, max((cell_len(word) for cell in cells for word in cell.split()), default=0)))
        if head in wrapped
        else width
        for (head, *cells), width in zip(zip(*rows, strict=True), widths, strict=True)
    ]
    for _ in range(sum(widths) + 2 * (len(widths) - 1) - most):
        widest = max(range(len(widths)), key=lambda number: widths[number] - least[number])
        widths[widest] = max(least[widest], widths[widest] - 1)
    return widths


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a table that need not be wrapped. To import a library for it would take longer than `rc list`."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
