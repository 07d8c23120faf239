"""`rc fmt`: format files of the languages."""

from __future__ import annotations

import argparse
import difflib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

from .common import FINE, WRONG, complain, files_of, show
from .completing import completed
from .replacing import replace_file

NAME = "fmt"

_ABOUT = """\
Format files in place. Their meaning and their comments do not change. A file that is already formatted, or has syntax
errors, is not touched. There is nothing to configure.
"""
_EXAMPLES = """\
examples:
  rc fmt .                          all files of the languages in this folder and below
  rc fmt --check interfaces         say which are not formatted, and change none: in a hook, or in CI
  rc fmt --diff arm.cdsl            show what would change
  rc fmt --language idsl - < Arm.idsl    from stdin to stdout: in an editor

exit status: 0 fine, 1 a file is wrong, or with --check and --diff one is not formatted, 2 usage
"""
_STDIN = Path("<stdin>")


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = _ABOUT, _EXAMPLES
    files = to.add_argument(
        "files", nargs="+", metavar="FILE", help="a file, a folder with everything below it, or - for stdin"
    )
    completed(files, ".idsl", ".cdsl", ".pdsl", ".ddsl", ".smdsl")
    to.add_argument("--check", action="store_true", help="list the files that are not formatted; change no file")
    to.add_argument("--diff", action="store_true", help="show what would change; change no file")
    to.add_argument("--language", metavar="NAME", help="what stdin is: idsl, cdsl, pdsl, ddsl or smdsl")
    to.set_defaults(usage_error=to.error)


def run(options: argparse.Namespace) -> int:
    _check_usage(options)
    if options.files == ["-"]:
        return _format_stdin(options)
    paths, problems = files_of(map(Path, options.files), linked=False)
    codes = [complain(f"rc fmt: {problem}") for problem in problems]
    return max([*codes, *(_format_file(path, options) for path in paths)], default=FINE)


def _check_usage(options: argparse.Namespace) -> None:
    from ..dsl.format import LANGUAGES
    from ..spelling import closest

    if "-" in options.files and len(options.files) > 1:
        options.usage_error("stdin (-) cannot be combined with files")
    if options.files == ["-"] and not options.language:
        options.usage_error("say what stdin is, as in: rc fmt --language idsl -")
    if options.files != ["-"] and options.language:
        options.usage_error("--language is for stdin (-); the ending of a file tells its language")
    if options.language and options.language not in LANGUAGES:
        near = closest(options.language, LANGUAGES)
        known = f"did you mean {near}?" if near else f"known: {', '.join(LANGUAGES)}"
        options.usage_error(f"no language is called {options.language}; {known}")


def _format_stdin(options: argparse.Namespace) -> int:
    found = _formatted(_STDIN, options.language, lambda _: sys.stdin.buffer.read())
    if found is None:
        return WRONG
    if options.check or options.diff:
        return found.told(options)
    sys.stdout.flush()
    sys.stdout.buffer.write(found.after)
    return FINE


def _format_file(path: Path, options: argparse.Namespace) -> int:
    from ..dsl.format import LANGUAGES
    from ..dsl.workspace import read_file

    language = path.suffix.lower()[1:]
    if language not in LANGUAGES and path.exists():
        endings = ", ".join(f".{each}" for each in LANGUAGES)
        return complain(f"rc fmt: {path}: files with this ending are not formatted; known: {endings}")
    found = _formatted(path, language, read_file)
    if found is None:
        return WRONG
    if found.before == found.after:
        return FINE
    if options.check or options.diff:
        return found.told(options)
    try:
        replace_file(path, found.after)
    except OSError as exc:
        return complain(f"rc fmt: {path}: {exc.strerror}; the file is as it was")
    print(f"formatted: {path}")
    return FINE


@dataclass(frozen=True)
class _Formatted:
    """The present text of a file, and the formatted one."""

    path: Path
    before: bytes
    after: bytes
    encoding: str

    def told(self, options: argparse.Namespace) -> int:
        """Print what would change; return the exit code."""
        if self.before == self.after:
            return FINE
        if options.diff:
            sys.stdout.writelines(self._difference())
        else:
            print(f"would format: {self.path}")
        return WRONG

    def _difference(self) -> Iterator[str]:
        texts = (data.decode(self.encoding) for data in (self.before, self.after))
        before, after = (list(StringIO(text, newline="\n")) for text in texts)
        for line in difflib.unified_diff(before, after, str(self.path), str(self.path)):
            yield line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"


def _formatted(path: Path, language: str, read: Callable[[Path], bytes]) -> _Formatted | None:
    """The formatted file; None, after printing the reason, if that is not possible."""
    from ..dsl.diagnostics import DslError
    from ..dsl.format import format_text
    from ..dsl.workspace import Workspace

    held = dict[Path, bytes]()
    workspace = Workspace(read=lambda path: held.setdefault(path, read(path)), middlewares=())
    source, told = workspace.source(path), workspace.report
    text = ""
    try:
        text = format_text(source.text, language, path) if source else ""
    except DslError as exc:
        told.extend(exc.diagnostics)
    show(told.diagnostics)
    if source is None or told.errors:
        return None
    # A file that is not UTF-8 is read and written as Latin-1, so every byte of its comments is kept.
    encoding = "latin-1" if any(each.code == "not-utf8" for each in told.diagnostics) else "utf-8"
    return _Formatted(path, held[path], text.encode(encoding), encoding)
