"""`rc`: all commands for components except generating and deploying. Each is a module in this folder."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from importlib import import_module
from typing import Protocol, cast

from ..arguments import Parser
from ..garbage import rare_collection
from ..numerics import one_thread
from . import completing
from .common import add_version, command, parser


class Command(Protocol):
    """The module of a command. It imports slow modules in `run`."""

    NAME: str

    def add_arguments(self, to: argparse.ArgumentParser) -> None: ...

    def run(self, options: argparse.Namespace) -> int: ...


GROUPS = {
    "models and code": {
        "lint": "check files of any of the languages",
        "fmt": "format files of any of the languages",
        "rename": "rename an operation, a state, ... in models and in the Python code that uses it",
        "graph": "draw a network or a state machine",
        "links": "show what carries the messages of a network, link by link",
        "sim": "simulate a scene of InnerModel as a component, and show and edit it in the browser",
    },
    "run": {
        "run": "run a component",
        "host": "run a helper process for the components of this machine, such as a router or a broker",
    },
    "see what runs": {
        "list": "list the components that run now, or their topics, queries and commands",
        "info": "show the contract of a topic, query, command or action, and what uses it",
        "echo": "print what is published to topics, or calls of queries and commands",
        "hz": "measure how often topics are published, and whether messages are missing",
        "bw": "measure how many octets a second topics publish, and the sizes of their messages",
        "delay": "measure how old messages of topics are when they arrive",
        "top": "show processor, memory, rates and durations of running components, again and again",
        "monitor": "show a running network in the browser: components, connections, rates, what is missing",
        "logs": "show what running components log",
        "doctor": "find out what is wrong with this machine and with what runs on it",
    },
    "talk to what runs": {
        "call": "call a query of a component, or send it a command",
        "pub": "publish messages to a topic",
        "action": "begin, watch and cancel goals of actions",
        "param": "show and change the parameters of running components",
        "log": "set the level of a running component's log",
        "clock": "show, pause and drive the clock that a network follows",
    },
    "recordings": {
        "record": "record what is published into MCAP files",
        "bag": "look into recordings; mend, merge, cut and convert them",
        "plot": "draw values or latencies of a recording",
        "replay": "publish a recording again, as it was in time",
        "rerun": "run the code of a component again, with what has entered it, and compare what goes out",
        "foxglove": "show a running network, or a recording, in Foxglove",
    },
    "for other programs": {
        "lsp": "the language server, which editors start; see docs/guides/editors.md",
        "mcp": "let an agent, such as a language model, read a network, and do what it allows",
        "completion": "print the script by which a shell completes commands, options and names",
    },
}
"""All commands, in the order of the help, by what they are for, each with what it does.

Each is the name of its module, which is imported only if it is needed: to import all takes longer than many run.
"""

COMMANDS = {name: told for commands in GROUPS.values() for name, told in commands.items()}

_LOOKING = {*GROUPS["see what runs"], *GROUPS["talk to what runs"]}
"""Commands that compute nothing with large arrays."""

RUN = "run"
"""The command that passes options on to the component."""

_DESCRIPTION = "Check, run, watch, record and simulate components. `rc COMMAND --help` tells more."

_WIDTH = 110
"""Longest line of the help, in characters."""

_EXAMPLES = """\
examples:
  rc lint interfaces/*.idsl           check files of any of the languages
  rc lint --json net.ddsl             ... one diagnostic a line, for machines
  rc fmt .                            format all files of the languages here and below
  rc rename Vault.idsl Vault.size count   rename something in models and in the code that uses it
  rc graph net.ddsl -o net.svg        draw a network, or a state machine
  rc links net.ddsl                   what carries the messages between its instances
  rc list                             what runs now
  rc echo LaserPub                    what it publishes; `rc hz`, `rc bw`, `rc delay` measure it
  rc doctor                           what is wrong with this machine and with what runs
  rc call Speech/say text=hello overwrite=true
  rc action send goTo target.x=3 target.y=0   begin a goal; Ctrl-C cancels it
  rc top                              processor, rates and durations of what runs
  rc monitor                          the same in the browser, with what is missing
  rc param set wander max_speed=0.8   change a dynamic parameter; `rc log wander debug` a level
  rc clock pause                      let a network in lock-step stand still; `rc clock step 0.5`
  rc logs wander -f --level warning   its warnings, and new ones as they come
  rc record -o run1                   record what is published; `rc bag info run1` shows it
  rc plot run1 LaserPub.scan[0].dist -o dist.svg   draw a recorded value, or `--latency`
  rc replay run1 --only LaserPub      publish it again, as it was in time
  rc foxglove                         show what runs, or a recording, in Foxglove
  rc mcp rescue                       what an agent, such as a language model, talks to
  rc rerun wander wander.mcap         run its code again, against its diary
  rc sim new house.xml -o house       a component that simulates a scene
  rc host zenoh                       the router that components share, if nothing else runs it
  rc run components/wander            run a component until Ctrl-C
  rc run . --set component.period=0.02 --name left
  rc run camera + detector            ... several in one process
  eval "$(rc completion bash)"        complete commands and names with the Tab key; or zsh, fish

exit status: 0 fine, 1 wrong input or a component failed, 2 usage, 3 a host is out of reach, 130/143 by a signal
"""


@command
def main(arguments: Sequence[str] | None = None) -> int:
    given = sys.argv[1:] if arguments is None else list(arguments)
    if completing.is_asked(arguments):
        from .candidates import answer

        return answer(completer, given)
    if given[:1] == [RUN]:
        return _run(given)
    if arguments is not None:
        return _do(given)
    threads = one_thread() if given[:1] and given[0] in _LOOKING else nullcontext()
    with rare_collection(), threads:  # without arguments, the process is this command
        return _do(given)


def _do(given: Sequence[str]) -> int:
    name = next((word for word in given if not word.startswith("-")), "")
    options, rest = parser_for(name).parse_known_args(given)
    if getattr(options, "arguments", None) == [] and not any(word.startswith("-") for word in rest):
        options.arguments, rest = rest, []  # behind an option: argparse has given it none by then
    if rest:
        options.parser.error(f"unrecognized arguments: {' '.join(rest)}")
    return module(options.command).run(options)


def _run(given: Sequence[str]) -> int:
    from . import run

    if (code := run.run_plain(given[1:])) is not None:
        return code
    first, *others = run.split(given)
    options, rest = parser_for(RUN).parse_known_args(first)
    return run.run(options, rest, options.parser, others)


def completer(words: Sequence[str], word: str) -> tuple[Parser, Sequence[str]]:
    """The parser for a word behind these, and those of them that it reads."""
    return parser_for(words[0] if words else "", word), words


def parser_for(name: str, beginning: str = "") -> Parser:
    """The parser of `rc` with the arguments of this command only; if there is no such command, with the names of all
    that begin so."""
    made = parser("rc", _DESCRIPTION, _EXAMPLES)
    made.usage = "rc COMMAND ..."
    commands = made.add_subparsers(dest="command", metavar="COMMAND", required=True, prog="rc", help=argparse.SUPPRESS)
    if name not in COMMANDS:
        for each in COMMANDS:
            if each.startswith(beginning):
                commands.add_parser(each, help=COMMANDS[each])
        made.description = f"{_DESCRIPTION}\n\n{_listed()}"
        return made
    own = commands.add_parser(name, help=COMMANDS[name], add_help=name != RUN)
    module(name).add_arguments(own)
    add_version(own, f"rc {name}")
    own.set_defaults(parser=own)
    return made


def _listed() -> str:
    """What each command does, in groups."""
    import shutil
    import textwrap

    room = max(map(len, COMMANDS)) + 4
    width = max(2 * room, min(_WIDTH, shutil.get_terminal_size().columns - 2))
    groups = []
    for title, commands in GROUPS.items():
        lines = [
            textwrap.fill(told, width, initial_indent=f"  {name}".ljust(room), subsequent_indent=" " * room)
            for name, told in commands.items()
        ]
        groups.append("\n".join([f"{title}:", *lines]))
    return "\n\n".join(groups)


def module(name: str) -> Command:
    return cast(Command, import_module(f".{name}", __package__))


if __name__ == "__main__":  # how a deployer starts components
    raise SystemExit(main())
