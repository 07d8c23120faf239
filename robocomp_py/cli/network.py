"""Shared by commands that read a network (.ddsl): the options that change it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from .common import add_include
from .completing import What, completed

if TYPE_CHECKING:
    from ..deploy.plan import Overrides, Plan


def add_network(to: argparse.ArgumentParser) -> None:
    """The network, and the options that change it."""
    to.add_argument("network", type=network, metavar="NET.ddsl", help="the network")
    add_overrides(to)


def network(text: str) -> Path:
    """The path of a network. Refuses other files, such as a component's model."""
    from ..dsl.workspace import ENDINGS

    path = Path(text)
    if path.suffix.lower() in ENDINGS and path.suffix.lower() != ".ddsl":
        raise argparse.ArgumentTypeError(f"`{text}` is not a network; give it a file that begins a Deployment (.ddsl)")
    return path


def add_overrides(to: argparse.ArgumentParser) -> None:
    chosen = to.add_argument(
        "--middleware",
        metavar="NAME",
        help="what carries the messages, whatever the network says; auto, or 'auto(dds)': the fastest for each link "
        "(default: what the network says, or else auto)",
    )
    completed(chosen, What.MIDDLEWARE)
    to.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="INSTANCE.KEY=VALUE",
        help="set a key of an instance's configuration; may be repeated",
    )
    to.set_defaults(clock=None, clock_speed=None, diary=[])
    add_include(to)


def add_clock(to: argparse.ArgumentParser) -> None:
    """The options for a network whose processes follow one clock."""
    to.add_argument(
        "--clock",
        metavar="INSTANCE",
        help="let all instances follow the clock of this one, in lock-step; none: each follows the machine's "
        "(default: what the network says)",
    )
    to.add_argument(
        "--speed",
        dest="clock_speed",
        type=_speed,
        metavar="FACTOR",
        help="seconds of that clock in a second; max: as fast as possible (default: 1)",
    )


def overrides_of(options: argparse.Namespace) -> Overrides:
    """The changes that the options ask for. Raises ValueError, with a message for people, if one is wrong."""
    from ..deploy.plan import Overrides

    _check_middleware(options.middleware)
    clock = "" if options.clock == "none" else options.clock
    settings, diaries = tuple(map(_assignment, options.set)), tuple(map(_diary, options.diary))
    return Overrides(options.middleware, settings, clock, options.clock_speed, diaries)


def override_words(options: argparse.Namespace) -> list[str]:
    """The options that change the network, as given: another command needs them to read the same network."""
    words = ["--middleware", options.middleware] if options.middleware else []
    words += [word for each in options.set for word in ("--set", each)]
    return [*words, *(word for each in options.include for word in ("-I", str(each)))]


def tell_notes(plan: Plan) -> None:
    """Say why a link does not use the fastest middleware. An output that cannot be written is ignored."""
    try:
        for note in plan.notes:
            print(f"note: {note}", file=sys.stderr, flush=True)
    except OSError:
        from ..deploy.streams import discard

        discard(sys.stderr)


def _check_middleware(name: str | None) -> None:
    """Raise ValueError if a middleware cannot carry a network, because then the option is wrong, not a file."""
    from ..contract.middleware import carrier
    from ..deploy.routes import unfit

    carried = carrier(name, "")
    fault = unfit(carried) if carried else None
    if fault:
        raise ValueError(f"--middleware {name}: {fault}")


def _speed(text: str) -> float:
    """A factor; 0 for `max`."""
    from ..contract.component import MAX_SECONDS

    try:
        factor = 0.0 if text == "max" else float(text)
    except ValueError:
        factor = -1.0
    if not (text == "max" or 0 < factor <= MAX_SECONDS):
        raise argparse.ArgumentTypeError(f"`{text}` is not a factor; write it as 10, 0.5 or max")
    return factor


def _diary(instance: str) -> tuple[str, str]:
    """What makes an instance write a diary in the working directory."""
    path = Path.cwd() / f"{instance.replace('/', '_')}.mcap"
    return instance, f"component.diary={json.dumps(str(path), ensure_ascii=False)}"


def _assignment(text: str) -> tuple[str, str]:
    instance, dot, assignment = text.partition(".")
    if not dot or "=" not in assignment or "=" in instance:
        raise ValueError(f"--set {text}: write it as INSTANCE.KEY=VALUE, as in world.component.period=0.02")
    return instance, assignment
