"""`rc clock`: the clock that a running network follows."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from .common import FINE, describe, print_table
from .completing import What, completed
from .live import (
    COMPONENT,
    EXIT_STATUS,
    Absent,
    add_json,
    add_middleware,
    add_waiting,
    awaited,
    components_named,
    positive,
    reported,
)

if TYPE_CHECKING:
    from ..tools.clocks import Clock
    from ..tools.network import Network

NAME = "clock"

MAX = "max"

_EXAMPLES = f"""\
examples:
  rc clock show                  which component leads, its time and speed, and how many follow
  rc clock pause                 all components stand still after the present instant
  rc clock step 0.5              let half a second pass, and stand still again
  rc clock speed 2               twice as fast as the clock on the wall; `max`: as fast as possible
  rc clock resume                go on at this speed
  rc clock pause --of world      if several clocks are led

A network follows a clock if its file says `clock world;`, or with `rcdeploy --clock world`.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Show, pause and drive the clock that the components of a running network follow."
    to.epilog = _EXAMPLES
    commands = to.add_subparsers(dest="does", metavar="COMMAND", required=True)

    def command(name: str, about: str) -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=about)
        describe(made, about, to)
        completed(made.add_argument("--of", metavar="COMPONENT", help=f"the leader: {COMPONENT}"), What.COMPONENT)
        add_waiting(made)
        add_middleware(made)
        add_json(made)
        return made

    command("show", "show which component leads, the time, and the speed")
    command("pause", "stand still after the present instant")
    command("resume", "go on at the speed that was set")
    step = command("step", "let some seconds pass, and stand still")
    step.add_argument("seconds", type=positive, metavar="SECONDS", help="of the clock; at most 1e9")
    setting = command("speed", "set the seconds of the clock in one second")
    chosen = setting.add_argument(
        "speed", type=speed_of, metavar="SPEED", help="1 is real time; max: as fast as possible"
    )
    completed(chosen, {MAX: "as fast as possible", "1": "real time"})


def run(options: argparse.Namespace) -> int:
    from ..errors import RemoteFailure
    from ..spelling import and_then
    from ..tools import clocks
    from ..tools.access import Access

    def pick(network: Network) -> tuple[Network, list[str]]:
        known = clocks.leaders(network)
        if not known:
            raise ValueError("no component leads a clock here; `rcdeploy NET.ddsl --clock world` lets `world` lead one")
        try:
            return network, components_named(known, [options.of] if options.of else [])
        except Absent as exc:
            raise ValueError(and_then(str(exc), f"these lead a clock: {', '.join(known)}")) from exc

    with reported(f"rc clock {options.does}") as code, Access() as access:
        network, leaders = awaited(options, pick)
        try:
            if options.does != "show":
                if len(leaders) > 1:
                    raise Absent(f"there are several clocks; choose one by --of: {', '.join(leaders)}")
                operation, arguments = _operation(options)
                clocks.drive(access, network, leaders[0], operation, arguments, options.timeout)
            _print([clocks.state(access, network, each, options.timeout) for each in leaders], options.json)
        except ValueError as exc:
            raise Absent(str(exc)) from exc
        except RemoteFailure as exc:  # the leader refuses
            raise Absent(f"{leaders[0]}: {exc.reason}") from exc
        return FINE
    return code()


def _operation(options: argparse.Namespace) -> tuple[str, tuple[float, ...]]:
    match options.does:
        case "step":
            return "step", (options.seconds,)
        case "speed":
            return "setSpeed", (options.speed,)
    return options.does, ()


def _print(found: list[Clock], as_json: bool) -> None:
    rows = []
    for each in found:
        speed = each.speed or MAX
        if as_json:
            told = {"leader": each.leader, "now": each.seconds, "speed": speed, "paused": each.paused}
            print(json.dumps({**told, "followers": each.followers}))
        stands = "paused" if each.paused else "runs"
        rows.append((each.leader, f"{each.seconds:.3f} s", f"{speed}", stands, " ".join(each.followers)))
    if not as_json:
        print_table(("leader", "time", "speed", "", "followers"), rows, wrapped=("followers",))


def speed_of(text: str) -> float:
    """Of a clock; 0 for `max`."""
    if text == MAX:
        return 0.0
    number = positive(text)
    if number > 1e6:
        raise argparse.ArgumentTypeError(f"`{text}` is more than 1000000; `max` is as fast as possible")
    return number
