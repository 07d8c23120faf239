"""`rc call`: calls a query, or sends a command."""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import TYPE_CHECKING

from .common import FINE, USAGE, WRONG
from .completing import What, completed
from .hosts import add_hosts, hosts_of
from .live import (
    EXIT_STATUS,
    Wrong,
    add_definitions,
    add_middleware,
    add_request,
    add_waiting,
    add_yes,
    allowed,
    awaited,
    check_one_host,
    count,
    one_of,
    positive,
    reported,
    request_of,
    spelled,
)

if TYPE_CHECKING:
    from ..tools.access import ThrownError
    from ..tools.network import Channel, Network

NAME = "call"

_EXAMPLES = f"""\
examples:
  rc call world/DifferentialRobot/getBaseState             what takes no arguments
  rc call setSpeedBase adv=200 rot=0.1                     arguments by their names
  rc call speech/Speech/say '{{"text": "hello", "overwrite": true}}'
  rc call getBaseState --repeat 10 --rate 5                ten times, five a second
  rc call GotoPoint/go @where.json                         the arguments from a file
  rc call GotoPoint/go                                     shows what it takes
  rc call wander/CommonBehavior/killYourSelf --yes         what is marked [confirm], without being asked

The answer is printed as JSON; nothing is printed if the operation returns nothing, or with --json `null`. A declared
exception is printed with its fields, and the exit status is 1.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Call a query of a running component and print its answer, or send it a command."
    to.epilog = _EXAMPLES
    operation = to.add_argument(
        "operation", metavar="NAME", help="world/Laser/getLaserData, or an unambiguous part of such a name"
    )
    completed(operation, What.CALLABLE)
    add_request(to)
    to.add_argument(
        "--deadline", type=positive, default=5.0, metavar="SECONDS", help="how long to wait for the answer (default: 5)"
    )
    to.add_argument(
        "--repeat", type=count, metavar="COUNT", help="number of calls (default: 1; with --rate until Ctrl-C)"
    )
    to.add_argument("--rate", type=positive, metavar="HZ", help="calls a second (default: one after the other)")
    add_yes(to)
    to.add_argument(
        "--json", action="store_true", help="print a line of JSON for each call, also for a declared exception"
    )
    add_definitions(to)
    add_waiting(to)
    add_hosts(to)
    add_middleware(to)


def run(options: argparse.Namespace) -> int:
    with reported("rc call") as code, hosts_of(options) as hosts:

        def pick(network: Network) -> tuple[Network, Channel]:
            return network, callable_in(network, options.operation)

        return _call(*awaited(options, pick, hosts), options)
    return code()


def callable_in(network: Network, name: str) -> Channel:
    """The served query or command that a name means. Raises ValueError."""
    from ..contract.interface import Pattern

    channel = one_of(network, name)
    if channel.pattern is Pattern.PUBLISH:
        raise Wrong(f"{channel.name} is a topic; `rc echo {name}` prints what is published")
    if not channel.providers:
        raise ValueError(f"no component serves {channel.name}")
    check_one_host(channel.name, [channel])
    return channel


def _call(network: Network, channel: Channel, options: argparse.Namespace) -> int:
    from ..contract.interface import Pattern
    from ..tools import asking
    from ..tools.access import Access, ThrownError
    from ..wire import json as values

    operation = channel.operation
    with Access() as access:
        told = asking.about(access, network, channel, min(options.deadline, asking.DEADLINE))
        taken = request_of(channel.name, operation.inputs, options.arguments, "rc call", told)
        if taken is None:
            return USAGE
        if refused := allowed(channel, told, "rc call", yes=options.yes):
            return refused
        most = options.repeat or (None if options.rate else 1)
        begun, made, code = time.monotonic(), 0, FINE
        while most is None or made < most:
            if made and options.rate:
                time.sleep(max(0.0, begun + made / options.rate - time.monotonic()))
            made += 1
            if channel.pattern is Pattern.COMMAND:
                access.send(channel, taken, options.timeout, options.deadline)
                continue
            try:
                shown = values.show_fields(operation.outputs, access.ask_again(channel, taken, options.deadline))
                if shown or options.json:
                    answer = shown["ret"] if list(shown) == ["ret"] else shown or None
                    print(json.dumps(answer) if options.json else spelled(answer), flush=True)
            except ThrownError as exc:
                _print_thrown(exc, as_json=options.json)
                code = WRONG
        return code


def _print_thrown(exc: ThrownError, *, as_json: bool) -> None:
    from ..wire import json as values

    fields, name = values.show_fields(exc.kind.all_fields, exc.values), exc.kind.name.replace("::", ".")
    if as_json:
        print(json.dumps({"exception": name, "fields": fields}), flush=True)
    else:
        print(f"rc call: {name}: {spelled(fields)}", file=sys.stderr)
