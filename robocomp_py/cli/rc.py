"""`rc`: all commands for components except generating and deploying. Each is a module in this folder."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Protocol

from . import call, echo, fmt, graph, host, hz, info, links, lint, lsp, pub, rename, run
from . import list as list_
from .common import add_version, command, parser


class Described(Protocol):
    NAME: str
    HELP: str

    def add_arguments(self, to: argparse.ArgumentParser) -> None: ...


class Command(Described, Protocol):
    """The module of a command. It imports slow modules in `run`."""

    def run(self, options: argparse.Namespace) -> int: ...


_COMMANDS: tuple[Command, ...] = (lint, fmt, rename, lsp, graph, links, host, list_, info, echo, hz, call, pub)
"""All except `run`, which passes options on to the component."""

_EXAMPLES = """\
examples:
  rc lint interfaces/*.idsl           check files of any of the languages
  rc lint --json net.ddsl             ... one diagnostic a line, for machines
  rc fmt .                            format all files of the languages here and below
  rc rename Vault.idsl Vault.size count   rename something in models and in the code that uses it
  rc graph net.ddsl -o net.svg        draw a network, or a state machine
  rc links net.ddsl                   what carries the messages between its instances
  rc list                             what runs now
  rc echo LaserPub                    what it publishes; `rc hz` tells how often
  rc call Speech/say text=hello overwrite=true
  rc host zenoh                       the router that components share, if nothing else runs it
  rc run components/wander            run a component until Ctrl-C
  rc run . --set component.period=0.02 --name left
  rc run camera + detector            ... several in one process

exit status: 0 fine, 1 wrong input or a component failed, 2 usage, 130/143 by a signal
"""


@command
def main(arguments: Sequence[str] | None = None) -> int:
    given = sys.argv[1:] if arguments is None else list(arguments)
    if given[:1] == [run.NAME] and (code := run.run_plain(given[1:])) is not None:
        return code
    made = parser("rc", "Check and run components.", _EXAMPLES)
    commands = made.add_subparsers(dest="command", metavar="COMMAND", required=True)
    parsers: dict[str, argparse.ArgumentParser] = {}
    every: tuple[Described, ...] = (*_COMMANDS, run)
    for each in every:
        own = commands.add_parser(each.NAME, help=each.HELP, add_help=each is not run)
        if given[:1] != [run.NAME] or each is run:
            each.add_arguments(own)
        add_version(own, f"rc {each.NAME}")
        parsers[each.NAME] = own
    first, *others = run.split(given)
    options, rest = made.parse_known_args(first)
    if options.command == run.NAME:
        return run.run(options, rest, parsers[run.NAME], others)
    if rest:
        parsers[options.command].error(f"unrecognized arguments: {' '.join(rest)}")
    return next(each for each in _COMMANDS if options.command == each.NAME).run(options)


if __name__ == "__main__":  # how a deployer starts components
    raise SystemExit(main())
