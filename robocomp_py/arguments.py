"""A parser of arguments that refuses empty values and says in plain words what is wrong; for all our commands."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

from .spelling import closest, enumerated


class Parser(argparse.ArgumentParser):
    """Unlike its base, it keeps the lines of descriptions and epilogs by default, and takes no abbreviated options: a
    script that has them would break once there is another option. So do its subparsers."""

    _width = 80
    """Longest line of the help, in characters."""

    def __init__(self, **options: Any) -> None:
        ours: dict[str, Any] = {"formatter_class": self._formatter, "allow_abbrev": False}
        super().__init__(**ours | options)

    def format_help(self) -> str:
        self._measure()
        return super().format_help()

    def format_usage(self) -> str:
        self._measure()
        return super().format_usage()

    def _formatter(self, prog: str) -> argparse.HelpFormatter:
        """A formatter of the known width. argparse makes one for each argument, and each would look for it."""
        return argparse.RawDescriptionHelpFormatter(prog, width=self._width)

    def _measure(self) -> None:
        """Look once for the width of the terminal."""
        import shutil

        self._width = shutil.get_terminal_size().columns - 2

    def parse_known_args(  # type: ignore[override]  # of its overloads, which differ only in the namespace
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        given = list(sys.argv[1:] if args is None else args)
        if wrong := next(_empty(given), ""):
            self.error(wrong)
        return super().parse_known_args(given, namespace)

    def error(self, message: str) -> NoReturn:
        super().error(self._plain(message))

    def _plain(self, message: str) -> str:
        """In words of ours, what argparse says in its own."""
        if found := _NO_VALUE.fullmatch(message):
            return f"{found[1]} needs a value"
        if found := _NO_FLAG.fullmatch(message):
            return f"{found[1]} takes no value"
        if found := _NO_CHOICE.fullmatch(message):
            what, given, known = found[1], found[2], re.findall(r"[\w.-]+", found[3])
            name = f"no command `{given}`" if what == "COMMAND" else f"{what}: there is no `{given}`"
            near = closest(given, known)
            return f"{name}; " + (f"did you mean `{near}`?" if near else f"there are: {', '.join(known)}")
        if found := _UNKNOWN.fullmatch(message):
            option = found[1].partition("=")[0]
            if option.startswith("-"):
                near = closest(option, [text for text in self.options() if text.startswith("--")])
                return f"no option {option}; " + (f"did you mean {near}?" if near else f"see: {self.prog} --help")
            return f"there is no place for `{found[1]}`; see: {self.prog} --help"
        if found := _EXCLUDED.fullmatch(message):
            return f"{found[1]} and {found[2]} exclude each other"
        if found := _MISSING.fullmatch(message):
            may_be_empty = {each.metavar for each in self._actions if each.nargs == "*"}
            missing = [name for name in found[1].split(", ") if name not in may_be_empty]
            if missing == ["COMMAND"]:
                known = self._commands()
                listed = f": {', '.join(known)}" if len(known) <= _MOST_COMMANDS else ""
                return f"a command is missing{listed}; see: {self.prog} --help"
            return f"{enumerated(missing)} {'is' if len(missing) == 1 else 'are'} missing; see: {self.prog} --help"
        return message.removeprefix("argument ")

    def _commands(self) -> list[str]:
        found = (each.choices for each in self._actions if each.metavar == "COMMAND")
        return [name for choices in found for name in choices or ()]

    def options(self, *, with_value: bool = False) -> list[str]:
        """Its options, or those that take a value."""
        actions = self._actions  # argparse offers no public way
        return [text for each in actions if not with_value or each.nargs != 0 for text in each.option_strings]


_MOST_COMMANDS = 8
"""More are not listed in a message."""

_NO_VALUE = re.compile(r"argument (\S+): expected (?:one|at least one) argument")
_EXCLUDED = re.compile(r"argument (\S+): not allowed with argument (\S+)")
_MISSING = re.compile(r"the following arguments are required: (.*)")
_NO_FLAG = re.compile(r"argument (\S+): ignored explicit argument .*", re.DOTALL)
_NO_CHOICE = re.compile(r"argument (\S+): invalid choice: '?(.*?)'? \(choose from (.*)\)", re.DOTALL)
_UNKNOWN = re.compile(r"unrecognized arguments: (\S+).*", re.DOTALL)
_EMPTY_OPTION = re.compile(r"(--[\w-]+)=")


def _empty(given: Sequence[str]) -> Iterator[str]:
    """What is wrong with arguments that say nothing, as an unset variable of a shell leaves them."""
    before = ""
    for each in given:
        if each == "--":
            return
        if found := _EMPTY_OPTION.fullmatch(each):
            yield f"{found[1]} has an empty value"
        elif not each.strip():
            yield f"{before} has an empty value" if before.startswith("-") else "an argument is empty"
        before = each
