"""`rcdeploy`: networks of components, started, watched and stopped. Each command is a module of `deploying`.

Slow modules are imported when `main` runs, which ends quietly on Ctrl-C even during an import.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from ..arguments import Parser
from ..dsl.diagnostics import did_you_mean
from ..spelling import enumerated
from . import completing
from .common import command, parser
from .completing import completed
from .deploying import down, export, keys, logs, plan, restart, simulate, start, status, stop, trust, up
from .deploying.importing import import_network
from .network import add_clock, add_overrides, network


class Command(Protocol):
    """The module of a command. It imports slow modules in `run`."""

    NAME: str
    HELP: str

    def add_arguments(self, to: argparse.ArgumentParser) -> None: ...

    def run(self, options: argparse.Namespace) -> int: ...


COMMANDS: dict[str, Command] = {
    each.NAME: each for each in (up, plan, simulate, status, logs, restart, stop, start, down, export, keys, trust)
}

_EXAMPLES = """\
examples:
  rcdeploy net.ddsl                              start everything; Ctrl-C stops it, twice kills it
  rcdeploy net.ddsl --middleware zeromq          ... over that middleware and no other
  rcdeploy net.ddsl --for 30                     ... for half a minute
  rcdeploy net.ddsl --until mission              ... until that instance ends
  rcdeploy net.ddsl --set world.params.step=0.1  set a key of an instance's configuration (*: of all)
  rcdeploy plan net.ddsl                         show what would run, and start nothing
  rcdeploy simulate net.ddsl --for 60            run it in virtual time, as fast as possible
  rcdeploy up net.ddsl --detach                  start everything, and return when it is ready
  rcdeploy status net.ddsl                       ... how it is; see logs, restart, stop and down, too
  rcdeploy plan --help                           how to use that command
  rcdeploy ./plan                                start a network whose file is called like a command
  rcdeploy --import deployment.xml -o net.ddsl   make a network of rcmanager's XML

The whole network is checked first; nothing is started while anything is wrong.
Exit status: 0 fine, 1 wrong input or something failed, 2 usage, 3 a host cannot be reached,
130/143 stopped by a signal.
"""


@command
def main(arguments: Sequence[str] | None = None) -> int:
    given = list(sys.argv[1:] if arguments is None else arguments)
    if completing.is_asked(arguments):
        from .candidates import answer

        return answer(completer, given)
    at = _command_at(given)
    if at is None:
        return _without_command(given)
    chosen = COMMANDS[given.pop(at)]
    made = _parser_of(chosen)
    options, rest = made.parse_known_intermixed_args(given)
    _refuse(rest, made, chosen.NAME)
    return chosen.run(options)


def completer(words: Sequence[str], word: str) -> tuple[Parser, Sequence[str]]:
    """The parser for a word behind these, and those of them that it reads."""
    at = _command_at(words)
    if at is not None:
        return _parser_of(COMMANDS[words[at]]), [*words[:at], *words[at + 1 :]]
    return _parser(words="?"), words


def _without_command(given: Sequence[str]) -> int:
    """`rcdeploy NET.ddsl` and `rcdeploy --import`."""
    made = _parser()
    options, rest = made.parse_known_intermixed_args(given)
    words = [*options.words, *(word for word in rest if not word.startswith("-"))]
    if options.output and not options.imported:
        made.error("-o is for --import")
    if options.imported and words:
        made.error(f"--import {options.imported} imports and starts nothing; leave out `{' '.join(words)}`")
    _refuse([word for word in rest if word.startswith("-")], made, "")
    if options.imported:
        return import_network(options.imported, options.output)
    meant = _ELSEWHERE.get(words[0], "") if words and not Path(words[0]).exists() else ""
    if len(words) > 1 and words[1] in COMMANDS and words[0] not in COMMANDS:
        made.error(f"the command comes first: rcdeploy {words[1]} {words[0]}")
    if len(words) == 2 or meant:
        proposal = did_you_mean(meant or words[0], COMMANDS) or f"there are: {', '.join(COMMANDS)}"
        made.error(f"no command `{words[0]}`; {proposal}")
    if len(words) != 1:
        made.error("give it one network (.ddsl)")
    try:
        options.network = network(words[0])
    except argparse.ArgumentTypeError as exc:
        made.error(str(exc))
    return up.run(options)


_ELSEWHERE = {"kill": "down", "run": "up", "ps": "status", "list": "status"}
"""What our commands are called in other programs."""


def _parser(words: str = "*") -> Parser:
    """`words` is how many there may be, as argparse writes it."""
    made = parser("rcdeploy", "Start, watch and stop a network of components described in DDSL.", _EXAMPLES)
    made.usage = "rcdeploy [options] NET.ddsl\n       rcdeploy COMMAND ...\n       rcdeploy --import FILE [-o NET.ddsl]"
    width = max(map(len, COMMANDS))
    listed = "\n".join(f"  {name:{width}}  {each.HELP}" for name, each in COMMANDS.items())
    made.description = f"{made.description}\n\ncommands:\n{listed}"
    network = made.add_argument("words", nargs=words, metavar="NET.ddsl", help="the network")
    completed(network, {name: each.HELP for name, each in COMMANDS.items()}, ".ddsl")
    up.add_options(made)
    made.add_argument(
        "--import",
        dest="imported",
        type=Path,
        metavar="FILE",
        help="write the network of another tool as DDSL",
    )
    made.add_argument("-o", dest="output", type=Path, metavar="NET.ddsl", help="with --import: where (default: stdout)")
    add_overrides(made)
    add_clock(made)
    return made


def _parser_of(each: Command) -> Parser:
    made = parser(f"rcdeploy {each.NAME}", "")
    each.add_arguments(made)
    return made


def _command_at(given: Sequence[str]) -> int | None:
    """The position of the command, if there is one: the first word that is neither an option nor its value."""
    if given and given[0] in COMMANDS:
        return 0
    valued = _options(with_value=True)
    at = 0
    while at < len(given) and given[at].startswith("-") and given[at] != "--":
        at += 2 if given[at] in valued else 1
    return at if at < len(given) and given[at] in COMMANDS else None


def _refuse(rest: Sequence[str], made: argparse.ArgumentParser, name: str) -> None:
    """Report arguments that the command does not accept."""
    if not rest:
        return
    option = rest[0].partition("=")[0]
    takers = [other for other in COMMANDS if option in _options(other)]
    if option.startswith("-") and takers:
        whose = enumerated(f"`rcdeploy {other}`" for other in takers)
        made.error(f"{option} is for {whose}" + (f", not for `rcdeploy {name}`" if name else ""))
    made.error(f"unrecognized arguments: {' '.join(rest)}")


def _options(of: str = "", *, with_value: bool = False) -> set[str]:
    """The options of one command, or of all commands."""
    parsers = [_parser_of(COMMANDS[of])] if of else [_parser(), *map(_parser_of, COMMANDS.values())]
    return {text for each in parsers for text in each.options(with_value=with_value)}


if __name__ == "__main__":
    raise SystemExit(main())
