"""Shared by the commands that look at a running network."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from .common import FINE, UNREACHABLE, USAGE, WRONG, add_include
from .completing import What, completed

if TYPE_CHECKING:
    from ..contract.types import Field, Type
    from ..runtime.RoboCompIntrospection import End
    from ..tools.hosts import Hosts
    from ..tools.network import Channel, Network
    from ..tools.tap import Back, Found, Lost, Seek

T = TypeVar("T")

_LOOK = 0.05
"""Seconds between two looks for a name that is not there yet."""

TOPIC = "world/LaserPub/pushLaserData, or a part of such a name"
COMPONENT = "robot1/wander, or its last part"
RECORDING = "a folder of `rc record`, or a file *.mcap"
"""What arguments may be, for the help of commands."""

EXIT_STATUS = (
    "exit status: 0 done, 1 what is named is not there, does not fit, or fails, 2 usage, 3 a host is out of reach,\n"
    "130/143 by a signal"
)

_LONGEST = 8
"""Candidates that are named."""


class Absent(Exception):
    """What a command needs is not there, or does not fit what is there; the text is for people."""


class Wrong(ValueError):
    """A name means something else than a command needs. To wait would not help."""


def positive(text: str) -> float:
    """A time in seconds, or a rate."""
    try:
        number = float(text.removesuffix("s"))
    except ValueError:
        number = 0.0
    if not 0 < number < 1e9:
        raise argparse.ArgumentTypeError(f"`{text}` is not a positive number")
    return number


def port(text: str) -> int:
    """The number of a port; 0: any free one."""
    number = int(text) if text.isascii() and text.isdecimal() else -1
    if not 0 <= number < 65536:
        raise argparse.ArgumentTypeError(f"`{text}` is not a port; write a number from 0 to 65535")
    return number


def count(text: str) -> int:
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"`{text}` is not a positive whole number")
    return int(text)


def add_middleware(to: argparse.ArgumentParser) -> None:
    chosen = to.add_argument(
        "--middleware",
        action="append",
        default=[],
        metavar="NAME",
        help="look at this middleware only; may be repeated (default: all that can tell what uses them)",
    )
    completed(chosen, What.MIDDLEWARE)


def add_waiting(to: argparse.ArgumentParser) -> None:
    to.add_argument(
        "--timeout",
        type=positive,
        default=5.0,
        metavar="SECONDS",
        help="how long to wait until it is there (default: 5)",
    )


def add_json(to: argparse.ArgumentParser) -> None:
    to.add_argument("--json", action="store_true", help="one JSON object a line, for machines")


def add_topics(to: argparse.ArgumentParser) -> None:
    """What commands that listen take."""
    topics = to.add_argument("topics", nargs="+", metavar="NAME", help=TOPIC)
    completed(topics, What.TOPIC)
    add_definitions(to)
    to.add_argument("--for", dest="seconds", type=positive, metavar="SECONDS", help="end after this time")
    add_waiting(to)
    add_middleware(to)
    add_json(to)


def add_definitions(to: argparse.ArgumentParser) -> None:
    """Where `definitions` searches."""
    add_include(to, "a folder of IDSL files, for programs that do not announce their contracts; may be repeated")


def add_request(to: argparse.ArgumentParser) -> None:
    """What `request_of` reads."""
    about = "a JSON object, @FILE with one, or FIELD=VALUE (a.b=1)"
    completed(to.add_argument("arguments", nargs="*", metavar="ARGUMENT", help=about), What.FIELD)


@contextmanager
def reported(command: str) -> Iterator[Callable[[], int]]:
    """Report expected errors. The function tells the exit code afterwards."""
    from ..errors import ConfigurationError, HostUnreachable, RobocompError
    from ..installed import asked_once

    code = 0
    try:
        with asked_once():
            yield lambda: code
    except (Absent, RobocompError) as exc:
        codes = {ConfigurationError: USAGE, HostUnreachable: UNREACHABLE}
        code = next((number for kind, number in codes.items() if isinstance(exc, kind)), WRONG)
        say(command, str(exc))


def say(command: str, text: str) -> None:
    """A message for people, which may have texts of other programs."""
    from ..printable import printable

    print(f"{command}: {printable(text)}", file=sys.stderr)


def awaited(
    options: argparse.Namespace,
    pick: Callable[[Network], T],
    hosts: Hosts | None = None,
    meanwhile: Callable[[], object] = lambda: None,
) -> T:
    """What `pick` finds in the network, once it finds it. Without hosts, only this one is looked at.

    `meanwhile` is what a command has to do in any case; it is called while middlewares wait for what others tell.

    Raises Absent after the timeout, with its last error, and HostUnreachable if a host could not be looked at.
    """
    from ..definitions import Definitions
    from ..errors import HostUnreachable
    from ..spelling import and_then
    from ..tools.census import take_census
    from .progress import Progress

    census = hosts.census if hosts else take_census
    definitions = Definitions(getattr(options, "include", ()))
    end = time.monotonic() + options.timeout
    with Progress(f"rc {options.command}") as progress:
        while True:
            try:
                seen = census(options.middleware, own=True, meanwhile=meanwhile)
                return pick(seen.complete(definitions.search))
            except ValueError as exc:
                if isinstance(exc, Wrong) or time.monotonic() > end:
                    if hosts and hosts.lost:
                        raise HostUnreachable(and_then(str(exc), f"it may be on {', '.join(hosts.lost)}")) from exc
                    raise Absent(str(exc)) from exc
                progress.show(f"waiting up to {options.timeout:g} s: {exc}")
            time.sleep(_LOOK)


def awaited_topics(options: argparse.Namespace, hosts: Hosts) -> list[Channel]:
    """The subscriptions that hear all publishers of the topics which the arguments of `add_topics` name.

    Raises Absent, and HostUnreachable.
    """
    topics = awaited(
        options, lambda network: topics_of(network, options.topics), hosts, lambda: _prepare_to_listen(options)
    )
    return subscriptions_of(understood(options, topics))


def _prepare_to_listen(options: argparse.Namespace) -> None:
    """Import what subscriptions need, which takes as long as some middlewares wait for what others tell."""
    from .. import installed

    import_module("robocomp_py.tools.tap")
    for name in options.middleware:
        with suppress(ImportError):  # it may be used on other hosts only
            installed.transport(name)


def seek_of(options: argparse.Namespace, hosts: Hosts) -> Seek | None:
    """How to find these topics on hosts that are out of reach now; None if all hosts could be asked."""
    if not hosts.lost:
        return None
    from ..definitions import Definitions
    from ..tools.absent import Absent
    from ..tools.tap import Seek

    definitions = Definitions(options.include)

    def look() -> tuple[Sequence[Channel], Collection[str]]:
        network = hosts.census(options.middleware, own=True).complete(definitions.search)
        try:
            return topics_of(network, options.topics), hosts.lost
        except ValueError:  # nothing publishes them now
            return (), hosts.lost

    return Seek(Absent(hosts.lost), look)


def subscriptions_of(topics: Iterable[Channel]) -> list[Channel]:
    """Those that hear all publishers of these topics."""
    return [each for topic in topics for each in topic.each_way()]


def understood(options: argparse.Namespace, topics: Sequence[Channel]) -> list[Channel]:
    """The topics whose contracts are understood. Says which ones are left out; if there is no other, it raises
    NotUnderstood.
    """
    from ..tools.network import NotUnderstood

    found: list[Channel] = []
    wrong: list[NotUnderstood] = []
    for each in topics:
        try:
            _ = each.operation
        except NotUnderstood as exc:
            wrong.append(exc)
        else:
            found.append(each)
    if wrong and not found:
        raise wrong[0]
    for why in wrong:
        say(f"rc {options.command}", f"{why}, so it is left out")
    return found


def tell_host(options: argparse.Namespace, told: Lost | Back) -> None:
    """Say that a host is not heard any more, while others are, or that it is heard again."""
    from ..tools.tap import Lost

    text = f"{told.why}; the others go on" if isinstance(told, Lost) else f"{told.host} is heard again"
    say(f"rc {options.command}", text)


def tell_found(options: argparse.Namespace, found: Found) -> None:
    """Say which hosts are heard now although they were out of reach at first."""
    for host in dict.fromkeys(each.host for each in found.topics):
        say(f"rc {options.command}", f"{host} is heard now")


def components_named(known: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """The components that these names mean, whole or by their last parts; without names, all. Raises Absent."""
    if not wanted:
        return list(known)
    from ..spelling import unknown

    found: list[str] = []
    for each in wanted:
        name = each.strip("/")
        meant = [one for one in known if one == name or one.endswith(f"/{name}")]
        if not meant:
            shorts = [one.rpartition("/")[2] for one in known]
            raise Absent(unknown("component", each, dict.fromkeys([*shorts, *known])))
        found += meant
    return list(dict.fromkeys(found))


def nothing_published(network: Network, wanted: Sequence[str], more: str = "") -> str:
    """The message that none of these topics is published, or with no names none at all."""
    from ..contract.interface import Pattern

    for name in () if more else wanted:
        if why := network.no_topic(name):
            return f"{why}; `rc echo --calls {name}` and `rc record --calls {name}` hear its calls"
    what = ", ".join(f"`{each}`" for each in wanted) or "anything"
    near = next(filter(None, (network.closest(each, Pattern.PUBLISH) for each in wanted)), "")
    hint = f"did you mean `{near}`?" if near else "`rc list --topics` shows all topics"
    return f"nothing publishes {what}{more}; {hint}"


def nothing_heard(options: argparse.Namespace) -> Absent:
    return Absent(f"nothing was heard in {options.seconds or options.timeout:g} s")


def topics_of(network: Network, wanted: Sequence[str]) -> list[Channel]:
    """The published topics that these names mean. Raises ValueError."""
    found: dict[str, Channel] = {}
    for name in wanted:
        if why := network.no_topic(name):
            raise Wrong(f"{why}; `rc echo --calls {name}` shows its calls")
        topics = _named_topics(network, name)
        if not any(each.providers for each in topics):
            raise ValueError(f"nothing publishes {topics[0].name} now")
        topics = [each for each in topics if each.providers]
        found |= {each.name: each for each in topics}
    return list(found.values())


def topic_to_publish(network: Network, name: str) -> Channel:
    """The only topic that a name means. Raises ValueError if there may be one later, and Wrong for what is no topic."""
    if why := network.no_topic(name):
        raise Wrong(f"{why}; `rc call {name}` calls it")
    try:
        return network.topic(name)
    except ValueError as exc:
        _named_topics(network, name)  # raises for a name that may appear
        raise Wrong(str(exc)) from None


def _named_topics(network: Network, name: str) -> list[Channel]:
    """Of what a name means, the topics. Raises ValueError, with a similar topic, and Wrong for an action."""
    from ..contract.interface import Pattern

    try:
        return [each for each in network.named(name) if each.pattern is Pattern.PUBLISH]
    except ValueError as exc:
        if network.has_action(name):
            raise Wrong(str(exc)) from None
        near = network.closest(name, Pattern.PUBLISH)
        raise ValueError(f"`{name}` is not there; did you mean `{near}`?") if near else exc from None


def one_of(network: Network, name: str) -> Channel:
    """The only channel that a name means. Raises ValueError, with the candidates."""
    try:
        found = network.named(name)
    except ValueError as exc:
        raise Wrong(str(exc)) if network.has_action(name) else exc from None
    if len(found) > 1:
        listed = ", ".join(each.name for each in found[:_LONGEST])
        raise Wrong(f"`{name}` may be {listed}{', …' if len(found) > _LONGEST else ''}; write more of the name")
    return found[0]


def check_one_host(what: str, channels: Iterable[Channel]) -> None:
    """Raise Wrong for what is served under one name on several hosts: a call would reach any of them."""
    from ..spelling import enumerated

    hosts = list(dict.fromkeys(host for each in channels for host in each.hosts))  # "" is this machine
    if len(hosts) > 1:
        named = enumerated(sorted(each or "this machine" for each in hosts))
        raise Wrong(f"{what} is served on {named}; choose one with --host {max(hosts)}")


def check_component_of_one_host(network: Network, component: str) -> None:
    """The same for a component, by its whole name."""
    kinds = ("Introspection", "CommonBehavior")
    channels = (each for kind in kinds for each in network.stock(kind))
    check_one_host(component, (each for each in channels if each.name.rsplit("/", 2)[0] == component))


def spelled(value: Any) -> str:
    """JSON on a terminal: in one line, with letters as they are, and without control characters of others."""
    from ..printable import one_line

    return one_line(json.dumps(value, ensure_ascii=False))


def add_yes(to: argparse.ArgumentParser) -> None:
    to.add_argument("--yes", action="store_true", help="do not ask before an operation that stops or moves something")


def allowed(channel: Channel, told: End | None, command: str, *, yes: bool) -> int:
    """0 if an operation may be used, after asking if it is marked `[confirm]`; else the exit code, after a message."""
    if yes or not (told.confirm if told else channel.operation.confirm):
        return FINE
    if not sys.stdin.isatty():
        print(f"{command}: {channel.name} stops or moves something; confirm it with --yes", file=sys.stderr)
        return USAGE
    print(f"{channel.name} stops or moves something. Go on? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() in ("y", "yes"):
        return FINE
    print(f"{command}: nothing was done", file=sys.stderr)
    return WRONG


def request_of(
    name: str, inputs: Sequence[Field], words: list[str], command: str, told: End | None = None
) -> tuple[Any, ...] | None:
    """The values of a request that these words describe; None, and a message, if the words are missing or malformed.

    `name` is that of a channel or an action, and `told` what a component tells of it. Raises Absent if the values do
    not fit it.
    """
    from ..wire import json as values

    if inputs and not words:
        print(f"{name} takes arguments; fill in:", file=sys.stderr)
        for each in told.comments if told else ():
            text = " ".join(each.text.split())
            print(f"  {each.about}: {text}" if each.about else f"  {text}", file=sys.stderr)
        print(json.dumps(values.template(inputs)))
        return None
    try:
        given = arguments_of(words, inputs)
    except ValueError as exc:
        say(command, str(exc))
        return None
    try:
        return values.take_fields(inputs, given, name.rpartition("/")[2])
    except ValueError as exc:
        raise Absent(str(exc)) from exc


def arguments_of(words: list[str], inputs: Sequence[Field]) -> Any:
    """The object that these words of a command line describe. Raises ValueError, with what these inputs need."""
    if len(words) == 1 and words[0].startswith("@"):
        path = Path(words[0][1:])
        try:
            return _loaded(path.read_bytes(), str(path))
        except OSError as exc:
            raise ValueError(f"{path}: {exc.strerror}") from exc
    if len(words) == 1 and words[0].lstrip().startswith("{"):
        return _loaded(words[0], "the argument")
    found: dict[str, Any] = {}
    for word in words:
        path_, equals, text = word.partition("=")
        if not equals:
            hint = _assigned(words, [each.name for each in inputs])
            raise ValueError(f"`{word}` is neither FIELD=VALUE, nor a JSON object, nor @FILE{hint}")
        *above, last = path_.split(".")
        inner = found
        for name in above:
            inner = inner.setdefault(name, {})
            if not isinstance(inner, dict):
                raise ValueError(f"`{word}`: `{name}` has a value of its own")
        if last in inner:
            raise ValueError(f"`{path_}` is given twice")
        inner[last] = _value(text, _type_of(inputs, path_))
    return found


def _type_of(inputs: Sequence[Field], path: str) -> Type | None:
    """The type of a field, such as `a.b`; None if there is no such field."""
    from ..contract.types import Dictionary, Struct

    first, *below = path.split(".")
    kind = next((each.type for each in inputs if each.name == first), None)
    for name in below:
        match kind:
            case Struct(fields=fields):
                kind = next((each.type for each in fields if each.name == name), None)
            case Dictionary():
                kind = kind.value
            case _:
                return None
    return kind


def _assigned(words: Sequence[str], names: Sequence[str]) -> str:
    """How to write words that name no field: `; write factor=3`."""
    if words[0] in names:
        values = words[1:2] if len(words) == 2 else ["VALUE"]
        return f"; write {words[0]}={values[0]}"
    is_by_position = len(words) == len(names) and not any("=" in each for each in words)
    return f"; write {' '.join(map('='.join, zip(names, words, strict=True)))}" if is_by_position else ""


def _value(text: str, kind: Type | None) -> Any:
    """JSON, or text as it is; for a text, `12` and `true` are texts, too."""
    from ..contract.types import STRING

    try:
        found = json.loads(text, parse_constant=str)  # NaN stays a text, which `wire.json` understands
    except (ValueError, RecursionError):
        return text
    return text if kind is STRING and not isinstance(found, str) else found


def _loaded(text: str | bytes, what: str) -> Any:
    try:
        return json.loads(text, parse_constant=str)
    except RecursionError as exc:
        raise ValueError(f"{what} is nested too deep") from exc
    except ValueError as exc:
        raise ValueError(f"{what} is no JSON: {exc}") from exc
