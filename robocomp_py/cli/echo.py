"""`rc echo`: what is published, and what is called."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..printable import one_line
from ..tools.shortening import shortened
from .common import UNREACHABLE, USAGE, raise_if_unread
from .hosts import HERE, add_hosts, code_of, hosts_of
from .live import (
    EXIT_STATUS,
    Absent,
    add_topics,
    awaited_topics,
    count,
    nothing_heard,
    reported,
    say,
    seek_of,
    spelled,
    tell_found,
    tell_host,
)

if TYPE_CHECKING:
    from ..tools.network import Channel
    from ..tools.parts import Condition, Part
    from ..tools.tap import Message, Presence

NAME = "echo"

_EXAMPLES = f"""\
examples:
  rc echo LaserPub                              all topics of this interface
  rc echo world/BatteryStatusPub -n 1           one message of one instance
  rc echo LaserPub --field laserData[0].dist    only a part of each message
  rc echo LaserPub --field laserData[*].dist    ... of all items of a sequence
  rc echo BatteryStatusPub --where 'level<20'   only messages that fit; several --where must all fit
  rc echo LaserPub --every 10                   every tenth message
  rc echo BatteryStatusPub --csv > battery.csv  a table: all fields, or those of --field
  rc echo LaserPub --stamps                     when and as which number each message was sent
  rc echo LaserPub --full --json                everything, for machines
  rc echo LaserPub --host base                  of another host of a network that rcdeploy runs here
  rc echo GotoPoint --calls                     its queries and commands, as those tell that call them
  rc echo GotoPoint --calls --served            ... as the server tells

A call is printed once it has ended: its caller, how it ended, how long that took, its arguments and its results. Calls
are told only while this command runs, by components that ran when it began.
A condition is a path, one of = != < <= > >=, and a value. With [*] in the path, one item that fits is enough.
Long sequences are cut, unless --full, --csv or --json is given. No publisher waits for this command.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Print the messages of topics, or calls of operations, as they come, until Ctrl-C."
    to.epilog = _EXAMPLES
    to.add_argument("--calls", action="store_true", help="print calls of queries and commands instead")
    to.add_argument("--served", action="store_true", help="with --calls: as servers report them, not clients")
    to.add_argument(
        "--field",
        action="append",
        default=[],
        metavar="PATH",
        help="print only this part: a.b, a[0].b, a[*].b, or * for all fields one by one; may be repeated",
    )
    to.add_argument(
        "--where",
        action="append",
        default=[],
        metavar="CONDITION",
        help="only messages that fit, such as 'a.b>3'; may be repeated",
    )
    to.add_argument("--every", type=count, default=1, metavar="COUNT", help="only each COUNT-th message of a topic")
    to.add_argument("--full", action="store_true", help="print long sequences whole")
    to.add_argument("--csv", action="store_true", help="print a table with a column for each field")
    to.add_argument("--stamps", action="store_true", help="also print when and as which number messages were sent")
    to.add_argument("-n", "--count", dest="most", type=count, metavar="COUNT", help="end after this number of messages")
    add_topics(to)
    add_hosts(to)


def run(options: argparse.Namespace) -> int:
    if options.csv and options.json:
        print("rc echo: --csv and --json exclude each other", file=sys.stderr)
        return USAGE
    if options.served and not options.calls:
        print("rc echo: --served is for --calls", file=sys.stderr)
        return USAGE
    with reported("rc echo") as code, hosts_of(options) as hosts:
        if options.calls:
            from .calls import echo_calls

            return echo_calls(options, hosts)
        topics = awaited_topics(options, hosts)
        from ..tools.tap import Back, Found, Lost, Presence, tapped  # loaded while the topics were awaited

        views, seek = _views(topics, options), seek_of(options, hosts)
        origin = _Origin(topics, several=seek is not None)
        printer = _Table(origin, views, options) if options.csv else _Lines(origin, views, options)
        heard, fitting, printed = 0, Counter[str](), 0
        full = options.full or options.csv or options.json or bool(options.field or options.where)
        ended = code_of(hosts)
        waits = {"first": options.timeout, "whole": options.seconds}
        for each in tapped(topics, **waits, full=full, seek=seek, meanwhile=raise_if_unread):
            if isinstance(each, Found):
                views |= _views(each.topics, options)
                tell_found(options, each)
                continue
            if isinstance(each, Presence):
                _tell(each)
                continue
            if isinstance(each, Lost | Back):
                ended = UNREACHABLE
                tell_host(options, each)
                continue
            heard += 1
            if each.dropped:
                why = "they come faster than they are printed"
                print(f"rc echo: {each.dropped} messages were dropped here: {why}", file=sys.stderr)
            if not views[each.channel, each.host].fits(each.message):
                continue
            fitting[each.channel] += 1
            if (fitting[each.channel] - 1) % options.every:
                continue
            printer.print(each)
            printed += 1
            if printed == options.most:
                break
        if not heard:
            raise nothing_heard(options)
        if not printed:
            raise Absent(f"{heard} messages were heard, and none fits --where")
        return ended
    return code()


@dataclass(frozen=True)
class _View:
    """What is shown of the messages of a topic."""

    parts: Sequence[Part]
    conditions: Sequence[Condition]
    is_one: bool
    """Whether only one part is wanted, which is then shown without its name."""

    def fits(self, message: Any) -> bool:
        """A message that is not understood fits if there is no condition."""
        if isinstance(message, str):
            return not self.conditions
        return all(each.fits(message) for each in self.conditions)

    def shown(self, message: Any) -> Any:
        if isinstance(message, str) or not self.parts:
            return message
        found = {each.path: each.of(message) for each in self.parts}
        return next(iter(found.values())) if self.is_one else found


_Views = Mapping[tuple[str, str], _View]
"""By channel and host."""


def _views(topics: Sequence[Channel], options: argparse.Namespace) -> dict[tuple[str, str], _View]:
    """Raises ConfigurationError if an option does not fit a contract."""
    fields = options.field or (["*"] if options.csv else [])
    if not fields and not options.where:
        return {(each.name, each.host): _View((), (), False) for each in topics}
    from ..errors import ConfigurationError
    from ..tools.parts import condition, parts

    views = {}
    for topic in topics:
        inputs = topic.operation.inputs
        try:
            wanted = [part for path in fields for part in parts(inputs, path)]
            conditions = [condition(inputs, text) for text in options.where]
        except ValueError as exc:
            raise ConfigurationError(f"{topic.name}: {exc}") from exc
        views[topic.name, topic.host] = _View(wanted, conditions, len(fields) == 1 and not fields[0].endswith("*"))
    columns = {tuple(each.path for each in view.parts) for view in views.values()}
    if options.csv and len(columns) > 1:
        listed = ", ".join(dict.fromkeys(channel for channel, _ in views))
        raise ConfigurationError(f"one table cannot have the fields of {listed}; name one topic, or fields of all")
    return views


class _Origin:
    """Tells a message's host if a topic comes from several, and its channel if there are several."""

    def __init__(self, topics: Sequence[Channel], *, several: bool) -> None:
        """`several`: further hosts may follow."""
        names, pairs = {each.name for each in topics}, {(each.name, each.host) for each in topics}
        shown = {"host": several or len(pairs) > len(names), "channel": len(names) > 1}
        self.heads = [head for head, is_shown in shown.items() if is_shown]

    def of(self, heard: Message) -> list[str]:
        told = {"host": heard.host or HERE, "channel": heard.channel}
        return [told[head] for head in self.heads]


class _Lines:
    """Prints a line for each message."""

    def __init__(self, origin: _Origin, views: _Views, options: argparse.Namespace) -> None:
        self._views, self._options, self._origin = views, options, origin

    def print(self, heard: Message) -> None:
        message = self._views[heard.channel, heard.host].shown(heard.message)
        if self._options.json:
            stamps = {"sent": heard.sent, "number": heard.number} if self._options.stamps else {}
            about = {"time": heard.time, "channel": heard.channel, "host": heard.host, **stamps}
            print(json.dumps({**about, "message": message}), flush=True)
            return
        stamps_ = [_sent(heard)] if self._options.stamps else []
        text = spelled(message if self._options.full else shortened(message))
        print(_clock(heard.time), *stamps_, *self._origin.of(heard), text, flush=True)


class _Table:
    """Prints comma-separated values, as RFC 4180 has them, but with plain line ends."""

    def __init__(self, origin: _Origin, views: _Views, options: argparse.Namespace) -> None:
        import csv

        self._views, self._stamps, self._origin = views, options.stamps, origin
        self._writer = csv.writer(sys.stdout, lineterminator="\n")
        self._is_terminal = sys.stdout.isatty()
        first = next(iter(views.values()))
        stamps = ["sent", "number"] if self._stamps else []
        self._row(["time", *stamps, *self._origin.heads, *(each.path for each in first.parts)])

    def print(self, heard: Message) -> None:
        if isinstance(heard.message, str):
            say("rc echo", f"{heard.channel}: {heard.message}")
            return
        stamps = [_seconds(heard.sent), _cell(heard.number)] if self._stamps else []
        values = [_cell(each.of(heard.message)) for each in self._views[heard.channel, heard.host].parts]
        self._row([_seconds(heard.time), *stamps, *self._origin.of(heard), *values])

    def _row(self, cells: Sequence[str]) -> None:
        self._writer.writerow(map(one_line, cells) if self._is_terminal else cells)
        sys.stdout.flush()


def _tell(presence: Presence) -> None:
    told = "is published again" if presence.is_published else "is no longer published: its publisher has ended"
    of = f" of {presence.host}" if presence.host else ""
    print(f"rc echo: {presence.channel}{of} {told}", file=sys.stderr)


def _clock(seconds: float) -> str:
    whole = int(seconds)
    return f"{time.strftime('%H:%M:%S', time.localtime(whole))}.{int((seconds - whole) * 1000):03d}"


def _sent(heard: Message) -> str:
    if heard.sent is None:
        return "(sent without a stamp)"
    number = "" if heard.number is None else f"number {heard.number} "
    return f"({number}sent {_clock(heard.sent)}, {(heard.time - heard.sent) * 1e3:.1f} ms)"


def _seconds(at: float | None) -> str:
    return "" if at is None else f"{at:.6f}"


def _cell(value: Any) -> str:
    """Text as it is, all else as JSON; nothing for what a message has not."""
    return "" if value is None else value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
