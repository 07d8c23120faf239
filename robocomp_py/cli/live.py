"""Shared by the commands that look at a running network."""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from .common import USAGE, WRONG

if TYPE_CHECKING:
    from ..tools.network import Channel, Network

T = TypeVar("T")

_LOOK = 0.05
"""Seconds between two looks for a name that is not there yet."""

EXIT_STATUS = "exit status: 0 done, 1 nothing is there or was heard, or the call failed, 2 usage, 130/143 by a signal"

_LONGEST = 8
"""Items of a sequence that are shown, unless all are wanted."""


class Absent(Exception):
    """What a command needs is not there; the text is for people."""


def positive(text: str) -> float:
    """A time in seconds, or a rate."""
    try:
        number = float(text.removesuffix("s"))
    except ValueError:
        number = 0.0
    if not 0 < number < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return number


def count(text: str) -> int:
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive whole number")
    return int(text)


def add_middleware(to: argparse.ArgumentParser) -> None:
    to.add_argument(
        "--middleware",
        action="append",
        default=[],
        metavar="NAME",
        help="look at this middleware only; may be repeated (default: all that can tell what uses them)",
    )


def add_waiting(to: argparse.ArgumentParser) -> None:
    to.add_argument(
        "--timeout", type=positive, default=5.0, metavar="SECONDS", help="how long to wait for it (default: 5)"
    )


def add_json(to: argparse.ArgumentParser) -> None:
    to.add_argument("--json", action="store_true", help="one JSON object a line, for machines")


@contextmanager
def reported(command: str) -> Iterator[Callable[[], int]]:
    """Report expected errors. The function tells the exit code afterwards."""
    from ..errors import ConfigurationError, RobocompError

    code = 0
    try:
        yield lambda: code
    except Absent as exc:
        code = WRONG
        print(f"{command}: {exc}", file=sys.stderr)
    except ConfigurationError as exc:
        code = USAGE
        print(f"{command}: {exc}", file=sys.stderr)
    except RobocompError as exc:
        code = WRONG
        print(f"{command}: {exc}", file=sys.stderr)


def awaited(options: argparse.Namespace, pick: Callable[[Network], T]) -> T:
    """What `pick` finds in the network, once it finds it. Raises Absent after the timeout, with its last error."""
    from ..tools.census import take_census

    end = time.monotonic() + options.timeout
    while True:
        try:
            return pick(take_census(options.middleware, own=True))
        except ValueError as exc:
            if time.monotonic() > end:
                raise Absent(str(exc)) from exc
        time.sleep(_LOOK)


def topics_of(network: Network, wanted: Sequence[str]) -> list[Channel]:
    """The topics that these names mean. Raises ValueError."""
    from ..contract.interface import Pattern

    found: dict[str, Channel] = {}
    for name in wanted:
        channels = network.named(name)
        topics = [each for each in channels if each.pattern is Pattern.PUBLISH and each.providers]
        if not topics:
            raise ValueError(f"`{name}` is no topic that is published: {channels[0].name} is a {channels[0].pattern}")
        found |= {each.name: each for each in topics}
    return list(found.values())


def one_of(network: Network, name: str) -> Channel:
    """The only channel that a name means. Raises ValueError, with the candidates."""
    found = network.named(name)
    if len(found) > 1:
        listed = ", ".join(each.name for each in found[:_LONGEST])
        raise ValueError(f"`{name}` may be {listed}{', …' if len(found) > _LONGEST else ''}; write more of the name")
    return found[0]


def part(value: Any, path: str) -> Any:
    """The part of JSON that a path such as `a.b[0]` names. Raises Absent."""
    steps = re.findall(r"\[(\d+)\]|([^.\[\]]+)", path)
    for number, name in steps:
        try:
            value = value[int(number)] if number else value[name]
        except (KeyError, IndexError, TypeError):
            known = f"; there is {', '.join(value)}" if isinstance(value, dict) else ""
            raise Absent(f"a message has no `{path}`: `{number or name}` is not there{known}") from None
    return value


def shortened(value: Any) -> Any:
    """The same JSON, with long arrays and texts cut."""
    match value:
        case dict():
            return {key: shortened(each) for key, each in value.items()}
        case list() if len(value) > _LONGEST:
            return [*map(shortened, value[: _LONGEST - 2]), f"… {len(value) - _LONGEST + 2} more"]
        case list():
            return [shortened(each) for each in value]
        case str() if len(value) > 200:
            return f"{value[:80]}… {len(value) - 80} more"
        case _:
            return value
