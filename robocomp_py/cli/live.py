"""Shared by the commands that look at a running network."""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
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


class Wrong(ValueError):
    """A name means something else than a command needs. To wait would not help."""


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


def add_topics(to: argparse.ArgumentParser) -> None:
    """What commands that listen take."""
    to.add_argument("topics", nargs="+", metavar="NAME", help="world/LaserPub/pushLaserData, or a part of such a name")
    to.add_argument("--for", dest="seconds", type=positive, metavar="SECONDS", help="end after this time")
    add_waiting(to)
    add_middleware(to)
    add_json(to)


def add_request(to: argparse.ArgumentParser) -> None:
    """What `request_of` reads."""
    to.add_argument(
        "arguments", nargs="*", metavar="ARGUMENT", help="a JSON object, @FILE with one, or FIELD=VALUE (a.b=1)"
    )


@contextmanager
def reported(command: str) -> Iterator[Callable[[], int]]:
    """Report expected errors. The function tells the exit code afterwards."""
    from ..errors import ConfigurationError, RobocompError

    code = 0
    try:
        yield lambda: code
    except (Absent, RobocompError) as exc:
        code = USAGE if isinstance(exc, ConfigurationError) else WRONG
        print(f"{command}: {exc}", file=sys.stderr)


def awaited(options: argparse.Namespace, pick: Callable[[Network], T]) -> T:
    """What `pick` finds in the network, once it finds it. Raises Absent after the timeout, with its last error."""
    from ..tools.census import take_census

    end = time.monotonic() + options.timeout
    while True:
        try:
            return pick(take_census(options.middleware, own=True))
        except ValueError as exc:
            if isinstance(exc, Wrong) or time.monotonic() > end:
                raise Absent(str(exc)) from exc
        time.sleep(_LOOK)


def awaited_topics(options: argparse.Namespace) -> list[Channel]:
    """The published topics that the arguments of `add_topics` name. Raises Absent."""

    def pick(network: Network) -> list[Channel]:
        return _topics_of(network, options.topics)

    return awaited(options, pick)


def nothing_heard(options: argparse.Namespace) -> Absent:
    return Absent(f"nothing was heard in {options.seconds or options.timeout:g} s")


def _topics_of(network: Network, wanted: Sequence[str]) -> list[Channel]:
    from ..contract.interface import Pattern

    found: dict[str, Channel] = {}
    for name in wanted:
        channels = network.named(name)
        topics = [each for each in channels if each.pattern is Pattern.PUBLISH]
        if not topics:
            raise Wrong(f"`{name}` is no topic: {channels[0].name} is a {channels[0].pattern}")
        if not any(each.providers for each in topics):
            raise ValueError(f"nothing publishes {topics[0].name} now")
        topics = [each for each in topics if each.providers]
        found |= {each.name: each for each in topics}
    return list(found.values())


def one_of(network: Network, name: str) -> Channel:
    """The only channel that a name means. Raises ValueError, with the candidates."""
    found = network.named(name)
    if len(found) > 1:
        listed = ", ".join(each.name for each in found[:_LONGEST])
        raise Wrong(f"`{name}` may be {listed}{', …' if len(found) > _LONGEST else ''}; write more of the name")
    return found[0]


def part(value: Any, path: str) -> Any:
    """The part of JSON that a path such as `a.b[0]` names. Raises Absent."""
    if not re.fullmatch(r"\w+(\.\w+|\[\d+\])*", path):
        raise Absent(f"`{path}` is no path; write it as a.b, or a.b[0]")
    steps = re.findall(r"\[(\d+)\]|(\w+)", path)
    for number, name in steps:
        try:
            if isinstance(value, str):
                raise TypeError("a text has no parts")
            value = value[int(number)] if number else value[name]
        except (KeyError, IndexError, TypeError):
            known = f"; there is {', '.join(value)}" if isinstance(value, dict) else ""
            known = f"; it has {len(value)} items" if isinstance(value, list) else known
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


def request_of(channel: Channel, words: list[str], command: str) -> tuple[Any, ...] | None:
    """The values of a request that these words describe; None, and a message, if they do not."""
    from ..wire import json as values

    inputs = channel.operation.inputs
    if inputs and not words:
        print(f"{channel.name} takes arguments; fill in:", file=sys.stderr)
        print(json.dumps(values.template(inputs)))
        return None
    try:
        return values.taken(inputs, arguments_of(words), channel.operation.name)
    except ValueError as exc:
        print(f"{command}: {exc}", file=sys.stderr)
        return None


def arguments_of(words: list[str]) -> Any:
    """The object that these words of a command line describe. Raises ValueError."""
    if len(words) == 1 and words[0].startswith("@"):
        path = Path(words[0][1:])
        try:
            return _loaded(path.read_text(encoding="utf-8"), str(path))
        except OSError as exc:
            raise ValueError(f"{path}: {exc.strerror}") from exc
    if len(words) == 1 and words[0].lstrip().startswith("{"):
        return _loaded(words[0], "the argument")
    found: dict[str, Any] = {}
    for word in words:
        path_, equals, text = word.partition("=")
        if not equals:
            raise ValueError(f"{word!r} is neither FIELD=VALUE, nor a JSON object, nor @FILE")
        *above, last = path_.split(".")
        inner = found
        for name in above:
            inner = inner.setdefault(name, {})
            if not isinstance(inner, dict):
                raise ValueError(f"{word!r}: `{name}` has a value of its own")
        inner[last] = _value(text)
    return found


def _value(text: str) -> Any:
    """JSON, or text as it is."""
    try:
        return json.loads(text, parse_constant=str)  # NaN stays a text, which `wire.json` understands
    except ValueError:
        return text


def _loaded(text: str, what: str) -> Any:
    try:
        return json.loads(text, parse_constant=str)
    except ValueError as exc:
        raise ValueError(f"{what} is no JSON: {exc}") from exc
